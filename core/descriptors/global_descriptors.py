"""Global descriptors of a surface: compactness and ratios to its convex hull.

They separate shapes whose geodesic distances agree, such as a cup and a vase.

J. Corney, H. Rea, D. Clark, J. Pritchard, M. Breaks, R. MacLeod, "Coarse filters for shape matching", IEEE
Computer Graphics and Applications 22(3), 2002.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from core.arrays import Floats, Ints
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, constant

GLOBAL_DESCRIPTORS = 3
"""Number of global descriptors."""

GLOBAL_WEIGHT = 0.1
"""Factor of the global descriptors in a signature; the eigenvalues dominate its Euclidean distance."""

LEAST_VOLUME = 1e-3
"""Added to volumes, in units of the area to the power 3/2 (a ball has 0.094). The volume of an open or flat
surface is 0 or arbitrary; with this its descriptors are finite and of moderate size."""


def global_descriptors(mesh: Mesh) -> Floats:
    """log(A^1.5 / V), log(H / V) and log(A / B), shape (3,): finite, invariant to rigid motion and scale.

    A is the area, V the enclosed volume, H and B are the volume and the area of the convex hull. V is the sum
    of the signed tetrahedra between the area centroid and the faces; for an open surface it is only a number.
    The descriptors fall with compactness, with the filled share of the hull and with smoothness.

    Parameters
    ----------
    mesh : Mesh
        Its area is > 0.
    """
    faces = mesh.faces
    areas = face_areas(mesh.vertices, faces)
    area = float(areas.sum())
    points = mesh.vertices - centroid(mesh.vertices, faces, areas)
    hull_volume, hull_area = _hull(points)
    least = LEAST_VOLUME * area**1.5
    volume = abs(signed_volume(points, faces)) + least
    return np.log([area**1.5 / volume, (hull_volume + least) / volume, area / hull_area])


def signed_volume(vertices: Floats, faces: Ints) -> float:
    """Sum of the signed volumes of the tetrahedra between the origin and each face.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
        Negative volume where a face is oriented inwards.
    """
    return _signed_volume(constant(vertices), constant(faces))


@compiled
def _signed_volume(vertices: Floats, faces: Ints) -> float:
    total = 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        total += vertices[a, 0] * (vertices[b, 1] * vertices[c, 2] - vertices[b, 2] * vertices[c, 1])
        total += vertices[a, 1] * (vertices[b, 2] * vertices[c, 0] - vertices[b, 0] * vertices[c, 2])
        total += vertices[a, 2] * (vertices[b, 0] * vertices[c, 1] - vertices[b, 1] * vertices[c, 0])
    return total / 6.0


def _hull(points: Floats) -> tuple[float, float]:
    """Volume and area of the convex hull; the hull of coplanar points counts both of its sides."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        axes = np.linalg.svd(points, full_matrices=False)[2]
        # QJ (joggled input): the points may be collinear within their plane.
        return 0.0, 2.0 * float(ConvexHull(points @ axes[:2].T, qhull_options="QJ").volume)
    return float(hull.volume), float(hull.area)
