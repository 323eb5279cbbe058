"""Measurements of a mesh: sizes, area, volume, damage."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from core.arrays import Floats, Ints
from core.embedding import Facts
from core.mesh.cleaning import Cleaned, centroid, component_areas, face_areas
from core.mesh.edges import boundary_edges, component_labels
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame, second_moments
from core.numerics.compilation import compiled_for_reading


def measure(mesh: Mesh, cleaned: Cleaned, frame: NormalFrame) -> Facts:
    """Return the measurements of a mesh, from the mesh as read, the cleaned mesh and its normal frame.

    Those of an open surface are of the surface without the discs that close its holes.
    """
    faces = cleaned.mesh.faces
    face_counts = cleaned.mesh.half_edges.face_counts
    areas = face_areas(cleaned.mesh.vertices, faces)
    area = float(areas.sum())
    # The frame is that of the surface with its holes filled.
    points = cleaned.mesh.vertices - centroid(cleaned.mesh.vertices, faces, areas)
    unit = frame.scale
    scale = unit * float(np.sqrt(np.trace(second_moments(points / unit, faces, areas / unit**2))))
    return Facts(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        area=area,
        volume=float(abs(signed_volume(points / unit, faces)) * unit**3),
        scale=scale,
        components=cleaned.components,
        merged_vertices=cleaned.merged_vertices,
        dropped_faces=cleaned.dropped_faces,
        boundary_edges=int((face_counts == 1).sum()),
        nonmanifold_edges=int((face_counts > 2).sum()),
        boundary_ratio=boundary_ratio(cleaned.mesh, area),
    )


LEAST_COMPONENT_AREA = 0.01
"""Boundary loops of components below this share of the area do not count: such components are debris, or the
triangles of a soup."""

MAIN_SHARE = 0.75
"""A surface whose largest component has a smaller share of its area is a model of several pieces, as most
models from the web are: open sheets and tubes, of which nothing is missing."""


def boundary_ratio(mesh: Mesh, area: float) -> float:
    """Return the area of the discs that the boundary loops could bound, over that of the surface, at most 1.

    A boundary loop is a connected set of boundary edges. A loop of length l bounds a disc of area at most
    l^2 / 4 pi (isoperimetric inequality), so a removed limb counts by its cross section, and many small holes
    count little. Components below `LEAST_COMPONENT_AREA` of the area are ignored, and the ratio of a surface
    of several pieces (`MAIN_SHARE`) is 0. Coincident vertices are merged; the area of the surface is > 0.
    """
    edges = boundary_edges(mesh.half_edges)
    if not len(edges):
        return 0.0
    areas = component_areas(mesh)
    edges = edges[areas[edges[:, 0]] >= LEAST_COMPONENT_AREA * area]
    if not len(edges) or areas.max() < MAIN_SHARE * area:
        return 0.0
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    _, labels = component_labels(len(mesh.vertices), edges)
    loop_lengths = np.bincount(labels[edges[:, 0]], weights=lengths) / np.sqrt(area)
    ratio = float((loop_lengths**2).sum() / (4.0 * np.pi))
    return min(1.0, ratio)


BOUNDARY_SHARE, NONMANIFOLD_SHARE = 0.02, 0.02
"""Shares of boundary edges and of nonmanifold edges, each of which halves the reliability."""

COMPONENT_WEIGHT = 0.5
"""Each component beyond the first counts as much as this share of such an amount."""


def intrinsic_reliability(facts: Facts) -> float:
    """Return a reliability in (0, 1]: 1 for a closed manifold mesh of one piece, near 0 for a polygon soup.

    1 / (1 + b / 0.02 + m / 0.02 + (k - 1) / 2), with b and m the shares of edges that have one face and more
    than two faces, and k the number of components.
    """
    edges = max(1.0, 1.5 * (facts.faces - facts.dropped_faces))
    faults = (
        facts.boundary_edges / edges / BOUNDARY_SHARE
        + facts.nonmanifold_edges / edges / NONMANIFOLD_SHARE
        + COMPONENT_WEIGHT * max(0, facts.components - 1)
    )
    return 1.0 / (1.0 + faults)


GLOBAL_DESCRIPTORS = 3
"""Number of global descriptors."""

GLOBAL_WEIGHT = 0.1
"""Factor of the global descriptors in a signature; the eigenvalues dominate its Euclidean distance."""

LEAST_VOLUME = 1e-3
"""Added to volumes, in units of the area to the power 3/2 (a ball has 0.094). The volume of an open or flat
surface is 0 or arbitrary; with this its descriptors are finite and of moderate size."""


def global_descriptors(mesh: Mesh) -> Floats:
    """Compute log(A^1.5 / V), log(H / V) and log(A / B), shape (3,): finite, invariant to similarities.

    A is the area, V the enclosed volume, H and B are the volume and the area of the convex hull. V is the sum
    of the signed tetrahedra between the area centroid and the faces; for an open surface it is only a number.
    The descriptors fall with compactness, with the filled share of the hull and with smoothness. A is > 0.
    """
    faces = mesh.faces
    areas = face_areas(mesh.vertices, faces)
    area = float(areas.sum())
    points = mesh.vertices - centroid(mesh.vertices, faces, areas)
    hull_volume, hull_area = _hull(points)
    least = LEAST_VOLUME * area**1.5
    volume = abs(signed_volume(points, faces)) + least
    return np.log([area**1.5 / volume, (hull_volume + least) / volume, area / hull_area])


@compiled_for_reading
def signed_volume(vertices: Floats, faces: Ints) -> float:
    """Compute the volume that faces, shape (f, 3), enclose, by tetrahedra; < 0 for inward faces."""
    total = 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        total += vertices[a, 0] * (vertices[b, 1] * vertices[c, 2] - vertices[b, 2] * vertices[c, 1])
        total += vertices[a, 1] * (vertices[b, 2] * vertices[c, 0] - vertices[b, 0] * vertices[c, 2])
        total += vertices[a, 2] * (vertices[b, 0] * vertices[c, 1] - vertices[b, 1] * vertices[c, 0])
    return total / 6.0


FLAT = 1e-12
"""Largest volume of a flat mesh, over the cube of its largest coordinate."""


def gyration_radii(mesh: Mesh) -> tuple[float, float, float]:
    """Return the principal radii of gyration of the enclosed solid, the largest first.

    The radii are root mean square distances along the principal axes from the centroid of the solid, in the
    units of the file (D. Eberly, "Polyhedral mass properties", 2002). The radii of an open mesh mean little;
    a flat mesh has radii of 0.
    """
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    points = np.where(used[:, None], mesh.vertices, mesh.vertices[mesh.faces[0, 0]])
    points -= 0.5 * points.min(axis=0) + 0.5 * points.max(axis=0)
    unit = float(np.abs(points).max())
    volume, first, second = _solid_moments(points / unit, mesh.faces)
    if abs(volume) <= FLAT:
        return 0.0, 0.0, 0.0
    centre = first / volume
    squares = np.linalg.eigvalsh(second / volume - np.outer(centre, centre))
    x, y, z = unit * np.sqrt(np.maximum(squares[::-1], 0.0))
    return float(x), float(y), float(z)


@compiled_for_reading
def _solid_moments(vertices: Floats, faces: Ints) -> tuple[float, Floats, Floats]:
    """Return the integrals of 1, p and p p^T over the enclosed solid; all are negative for inward faces."""
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        # The tetrahedron with the origin has the volume V, the integral V / 4 of the sum of its corners, and
        # V / 20 of the sum of p p^T over its corners and over their sum.
        part = a[0] * (b[1] * c[2] - b[2] * c[1])
        part += a[1] * (b[2] * c[0] - b[0] * c[2])
        part += a[2] * (b[0] * c[1] - b[1] * c[0])
        part /= 6.0
        volume += part
        for i in range(3):
            total = a[i] + b[i] + c[i]
            first[i] += part / 4.0 * total
            for j in range(3):
                product = a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + total * (a[j] + b[j] + c[j])
                second[i, j] += part / 20.0 * product
    return volume, first, second


def _hull(points: Floats) -> tuple[float, float]:
    """Return volume and area of the convex hull; the hull of coplanar points counts both of its sides."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        axes = np.linalg.svd(points, full_matrices=False)[2]
        # QJ (joggled input): the points may be collinear within their plane.
        return 0.0, 2.0 * float(ConvexHull(points @ axes[:2].T, qhull_options="QJ").volume)
    return float(hull.volume), float(hull.area)
