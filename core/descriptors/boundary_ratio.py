"""How much of a surface may be missing, by the length of its open boundary."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.mesh.cleaning import component_areas
from core.mesh.edges import HalfEdges
from core.mesh.mesh import Mesh

LEAST_COMPONENT_AREA = 0.01
"""Rims of parts of less than this share of the area are no gaps: loose bits, or the triangles of a soup."""


def boundary_ratio(mesh: Mesh, sides: HalfEdges, area: float) -> float:
    """Areas of the discs that the rims would bound, over the surface's area; >= 0.

    A rim of length l, which is what hangs together of the open edges, bounds a disc of at most l^2 / 4 pi. So
    a limb cut off counts by its cross section, and many small holes count little. Rims of parts of less than
    `LEAST_COMPONENT_AREA` of the area do not count.

    Parameters
    ----------
    mesh : Mesh
        With its coincident vertices merged.
    sides : HalfEdges
        Of its faces.
    area : float
        Of the surface, > 0.
    """
    edges = sides.edges[sides.face_counts == 1]
    if len(edges):
        edges = edges[component_areas(mesh)[edges[:, 0]] >= LEAST_COMPONENT_AREA * area]
    if not len(edges):
        return 0.0
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(mesh.vertices),) * 2)
    _, rim = connected_components(graph, directed=False)
    rims = np.bincount(rim[edges[:, 0]], weights=lengths) / np.sqrt(area)
    return float((rims**2).sum() / (4.0 * np.pi))
