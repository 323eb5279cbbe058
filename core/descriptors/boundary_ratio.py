"""The boundary ratio: how much of a surface may be missing, estimated from its boundary loops."""

import numpy as np

from core.mesh.cleaning import component_areas
from core.mesh.edges import HalfEdges, boundary_edges, component_labels
from core.mesh.mesh import Mesh

LEAST_COMPONENT_AREA = 0.01
"""Boundary loops of components below this share of the area do not count: such components are debris, or the
triangles of a soup."""

MAIN_SHARE = 0.75
"""A surface whose largest component has a smaller share of its area is a model of several pieces, as most
models from the web are: open sheets and tubes, of which nothing is missing."""


def boundary_ratio(mesh: Mesh, sides: HalfEdges, area: float) -> float:
    """Return the area of the discs that the boundary loops could bound, over that of the surface, at most 1.

    A boundary loop is a connected set of boundary edges. A loop of length l bounds a disc of area at most
    l^2 / 4 pi (isoperimetric inequality), so a removed limb counts by its cross section, and many small holes
    count little. Components below `LEAST_COMPONENT_AREA` of the area are ignored, and the ratio of a surface
    of several pieces (`MAIN_SHARE`) is 0.

    Parameters
    ----------
    mesh : Mesh
        Its coincident vertices are merged.
    sides : HalfEdges
        The half-edges of the mesh's faces.
    area : float
        Area of the surface, > 0.
    """
    edges = boundary_edges(sides)
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
