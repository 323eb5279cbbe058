"""Terms of a surface's overall form, which tell a cup from a vase where distances along it cannot.

J. Corney, H. Rea, D. Clark, J. Pritchard, M. Breaks, R. MacLeod, "Coarse filters for shape matching", IEEE
Computer Graphics and Applications 22(3), 2002: ratios of a shape to its convex hull, and compactness.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from core.arrays import Floats, Ints
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, constant

GLOBAL_DESCRIPTORS = 3

GLOBAL_WEIGHT = 0.1
"""What terms of form are multiplied by in a signature, so that its plain distance heeds eigenvalues first."""

LEAST_VOLUME = 1e-3
"""Added to volumes, over the area to the power 3/2 (a ball has 0.094): open and flat surfaces, whose volume
is nothing or chance, have finite terms that do not outweigh all else."""


def global_descriptors(mesh: Mesh) -> Floats:
    """log(A^1.5 / V), log(H / V) and log(A / B), shape (3,): finite, free of place, pose and size.

    A is the area, V the volume enclosed (by signed tetrahedra about the area's centroid, which is only a
    number where the surface is open), H and B the volume and area of the convex hull. The logarithms fall
    with compactness, with how much of its hull the shape fills, and with how smooth it is.
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
    """The sum of the tetrahedra between the origin and each face; negative where they face inwards."""
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
    """Volume and area of the convex hull; that of flat points has two sides."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        axes = np.linalg.svd(points, full_matrices=False)[2]
        # Joggled, since a needle may be flat in its plane as well.
        return 0.0, 2.0 * float(ConvexHull(points @ axes[:2].T, qhull_options="QJ").volume)
    return float(hull.volume), float(hull.area)
