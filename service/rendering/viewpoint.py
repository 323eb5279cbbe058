"""The view of a mesh: the upward axis of its format, and the camera."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.io import FORMATS

# The initial view in degrees, as on the page.
ELEVATION, AZIMUTH = 18.0, 28.0

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def upright(format: str) -> Floats:
    """The rotation matrix, shape (3, 3), that turns the upward axis of a format to y."""
    return np.eye(3) if FORMATS[format].y_up else _Z_UP


def camera() -> Floats:
    """The camera's axes as rows, shape (3, 3): right, up and towards the viewer, where y is up."""
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
    """The centre of the points' bounding box, shape (3,), and half its longest edge; 1 if all coincide."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = float((0.5 * high - 0.5 * low).max())
    return 0.5 * low + 0.5 * high, half or 1.0
