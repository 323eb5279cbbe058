"""Iterative closest points, by trimesh: the distance between two point clouds after the best rigid motion.

P. J. Besl, N. D. McKay, "A method for registration of 3-D shapes", IEEE PAMI 14(2), 1992.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.registration import icp
from trimesh.sample import sample_surface

from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame

Floats = NDArray[np.float64]

POINTS = 500
"""Number of samples of the surface, uniform by area."""


def describe(mesh: Mesh) -> Floats:
    """Random points of the surface, centred, along its principal axes, at unit scale: shape (POINTS, 3)."""
    cleaned = clean(mesh).mesh
    points = normal_frame(cleaned).apply(cleaned.vertices)
    surface = Trimesh(points, cleaned.faces, process=False)
    return np.asarray(sample_surface(surface, POINTS, seed=0)[0])


def compare(description: Floats, others: Sequence[Floats]) -> Floats:
    """Residuals of `closest_motion` from one cloud to each of c others, without mirroring: shape (c,)."""
    return np.array([closest_motion(description, other) for other in others])


def closest_motion(points: Floats, target: Floats, *, mirrored: bool = False) -> float:
    """The residual of the best rigid motion: the root mean square of distances both ways.

    Parameters
    ----------
    points, target : float64, shape (n, 3) and (m, 3)
        Both centred and along their principal axes. The search starts from the four rotations that keep
        these axes, each followed by trimesh's iterations; the best end counts.
    mirrored : bool
        Whether the four reflections are also starts.
    """
    tree = cKDTree(target)
    ends: list[float] = []
    for signs in product((1.0, -1.0), repeat=3):
        if mirrored or np.prod(signs) > 0.0:
            start = np.diag([*signs, 1.0])
            _, moved, _ = icp(  # type: ignore[no-untyped-call]
                points, target, initial=start, scale=False, reflection=False
            )
            there, back = tree.query(moved)[0], cKDTree(moved).query(target)[0]
            ends.append(float(np.sqrt(0.5 * ((there**2).mean() + (back**2).mean()))))
    return min(ends)
