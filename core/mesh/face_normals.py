"""Normals of triangles."""

import numpy as np

from core.arrays import Floats


def face_normals(corners: Floats, *, unit: bool = True) -> Floats:
    """Normals of triangles by the right-hand rule, shape (f, 3).

    Parameters
    ----------
    corners : float64, shape (f, 3, 3)
        The three corners of each triangle, counterclockwise seen from the tip of its normal.
    unit : bool
        True for normals of length 1, and 0 for triangles without area; False for normals as long as twice the
        area of their triangle.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if unit:
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(normals)
