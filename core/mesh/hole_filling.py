"""Holes closed, so that distances over the surface are those of the shape that it is a part of.

Where a scan has a hole, or a limb is cut off, paths go round it, and the Laplacian's domain ends there. A rim
is closed by a fan about its middle, if the disc that it bounds is smaller than the surface. The edge of a
sheet, or of a triangle by itself, is no hole: what can lie flat is no larger than its rim's disc.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Ints
from core.mesh.cleaning import component_areas
from core.mesh.edges import HalfEdges, half_edges
from core.mesh.mesh import Mesh


def fill_holes(mesh: Mesh, most: float, sides: HalfEdges | None = None) -> Mesh:
    """The mesh with its holes closed: a vertex amid each rim, and a face to it from each of the rim's edges.

    A rim is a closed line of edges with one face each, which meet nowhere else. One of length l bounds a disc
    of at most l^2 / 4 pi.

    Parameters
    ----------
    mesh : Mesh
        With its coincident vertices merged.
    most : float
        Rims are closed whose discs are at most this share of the area of the part that they are of; >= 0.
    sides : HalfEdges, optional
        Of its faces, where they are known.

    Returns
    -------
    Mesh
        The same one where there is nothing to close; else with more vertices and faces behind its own.
    """
    start, end = _boundary_edges(mesh.faces, half_edges(mesh.faces) if sides is None else sides)
    if not len(start):
        return mesh
    loops = _boundary_loops(start, end, len(mesh.vertices))
    count = int(loops.max()) + 1
    if not count:
        return mesh
    on = loops >= 0
    start, end, loops = start[on], end[on], loops[on]
    lengths = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    whole = np.bincount(loops, weights=lengths)
    area = component_areas(mesh)[start[np.unique(loops, return_index=True)[1]]]
    closed = whole**2 <= 4.0 * np.pi * most * area
    if not closed.any():
        return mesh
    # By the length of the edges, so that more vertices on one side do not draw the middle there.
    between = lengths[:, None] * (mesh.vertices[start] + mesh.vertices[end]) / 2.0
    middles = np.stack([np.bincount(loops, weights=each) for each in between.T], axis=1) / whole[:, None]
    number = len(mesh.vertices) + np.cumsum(closed) - 1
    used = closed[loops]
    fans = np.stack([end[used], start[used], number[loops[used]]], axis=1)
    return Mesh(np.concatenate([mesh.vertices, middles[closed]]), np.concatenate([mesh.faces, fans]))


def _boundary_edges(faces: Ints, sides: HalfEdges) -> tuple[Ints, Ints]:
    """The ends of the sides whose edge no other face has, as their faces run."""
    alone = sides.order[sides.first[sides.face_counts == 1]]
    return faces.ravel()[alone], faces[:, [1, 2, 0]].ravel()[alone]


def _boundary_loops(start: Ints, end: Ints, vertices: int) -> Ints:
    """The number of each side's rim, counted by their first vertices; -1 where sides meet in other ways.

    Each vertex of a rim has one side that begins there, and one that ends.
    """
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(vertices, vertices))
    _, part = connected_components(graph, directed=False)
    once = np.bincount(start, minlength=vertices) == np.bincount(end, minlength=vertices)
    once &= np.bincount(start, minlength=vertices) <= 1
    bad = np.zeros(len(once), dtype=bool)
    bad[part[~once]] = True
    good = np.flatnonzero(~bad[part[start]])
    loops = np.full(len(start), -1, dtype=np.int64)
    _, first, inverse = np.unique(part[start[good]], return_index=True, return_inverse=True)
    lowest = np.full(len(first), vertices)
    np.minimum.at(lowest, inverse, start[good])
    loops[good] = np.argsort(np.argsort(lowest))[inverse]
    return loops
