"""How a mesh is looked at: which way is up, and from where."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats

# By the custom of the programs that write them. In the other formats z is up.
Y_UP = frozenset({"glb", "obj"})

# The first view, in degrees: the page begins with the same.
ELEVATION, AZIMUTH = 18.0, 28.0

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def upright(format: str) -> Floats:
    """The rotation, shape (3, 3), after which y is up."""
    return np.eye(3) if format in Y_UP else _Z_UP


def camera() -> Floats:
    """Rows are right, up and towards the eye, shape (3, 3), in a frame where y is up."""
    elevation, azimuth = np.radians([ELEVATION, AZIMUTH])
    towards = np.array(
        [
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
            np.cos(elevation) * np.cos(azimuth),
        ]
    )
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    return np.stack([right, np.cross(towards, right), towards])


def frame(vertices: Floats) -> tuple[NDArray[np.float64], float]:
    """The middle of the box about some points, shape (3,), and half its longest edge; 1 if they coincide."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = float((0.5 * high - 0.5 * low).max())
    return 0.5 * low + 0.5 * high, half or 1.0
