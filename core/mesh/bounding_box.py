"""The bounding box of a surface along its principal axes."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from core.arrays import Floats
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import TIED, second_moments

SIDES = 32
"""Most sides of the convex hull that a box may stand on, if all three axes are tied."""


def bounding_box(mesh: Mesh) -> tuple[float, float, float]:
    """Length, width and height of a surface along its principal axes, independent of its position.

    The principal axes are the eigenvectors of the area-weighted second moments. Tied axes
    (`core.mesh.normal_frame.TIED`) have no direction of their own. The box of two tied axes is the rectangle
    of least area in their plane; the box of three is the least box on one of the largest sides of the convex
    hull.

    Parameters
    ----------
    mesh : Mesh
        With area > 0. Every face counts, also the debris that cleaning drops.

    Returns
    -------
    tuple of float
        The three extents in the units of the file, the largest first.
    """
    areas = face_areas(mesh.vertices, mesh.faces)
    centred = mesh.vertices - centroid(mesh.vertices, mesh.faces, areas)
    values, vectors = np.linalg.eigh(second_moments(centred, mesh.faces, areas))
    values, axes = values[::-1], vectors.T[::-1]
    used = np.zeros(len(centred), dtype=bool)
    used[mesh.faces] = True
    along = centred[used] @ axes.T
    tied = values[:-1] - values[1:] < TIED * values[:-1]
    extents = np.ptp(along, axis=0)
    try:
        if tied.all():
            extents = _least_box(along)
        elif tied[0]:
            extents = np.array([*_least_rectangle(along[:, :2]), extents[2]])
        elif tied[1]:
            extents = np.array([extents[0], *_least_rectangle(along[:, 1:])])
    except QhullError:
        # The points lie on a line to the precision of their coordinates.
        pass
    length, width, height = sorted(map(float, extents), reverse=True)
    return length, width, height


def _least_box(points: Floats) -> Floats:
    """Extents of the least box on one of the largest sides of the convex hull of points, shape (n, 3)."""
    hull = ConvexHull(points)
    corners = points[hull.vertices]
    first, second, third = (points[hull.simplices[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    rounded = np.round(hull.equations[:, :3], 3)
    _, first_of, side_of = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    largest = np.argsort(-np.bincount(side_of.ravel(), weights=areas))[:SIDES]
    boxes = []
    for normal in hull.equations[first_of[largest], :3]:
        across = np.linalg.svd(normal[None])[2][1:]
        boxes.append([*_least_rectangle(corners @ across.T), np.ptp(corners @ normal)])
    return np.array(min(boxes, key=np.prod))


def _least_rectangle(points: Floats) -> Floats:
    """Extents of the rectangle of least area around points in a plane, shape (n, 2).

    One of its sides lies on an edge of the convex hull (Freeman and Shapira 1975).
    """
    corners = points[ConvexHull(points).vertices]
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    _, distinct = np.unique(np.round(edges, 5), axis=0, return_index=True)
    rectangles = [
        (float(np.ptp(corners @ (x, y))), float(np.ptp(corners @ (-y, x)))) for x, y in edges[distinct]
    ]
    return np.array(min(rectangles, key=np.prod))
