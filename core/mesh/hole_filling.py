"""Holes closed, so that distances over the surface are those of the shape that it is a part of.

Where a scan has a hole, or a limb is cut off, paths go round it, and the Laplacian's domain ends there. A rim
is closed by a fan about its middle, if the disc that it bounds is smaller than the surface. The edge of a
sheet, or of a triangle by itself, is no hole: what can lie flat is no larger than its rim's disc.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Ints
from core.mesh.cleaning import part_areas
from core.mesh.edges import HalfEdges, half_edges
from core.mesh.mesh import Mesh


def filled(mesh: Mesh, most: float, sides: HalfEdges | None = None) -> Mesh:
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
    start, end = _open_sides(mesh.faces, half_edges(mesh.faces) if sides is None else sides)
    if not len(start):
        return mesh
    rims = _rims(start, end, len(mesh.vertices))
    count = int(rims.max()) + 1
    if not count:
        return mesh
    on = rims >= 0
    start, end, rims = start[on], end[on], rims[on]
    lengths = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    whole = np.bincount(rims, weights=lengths)
    area = part_areas(mesh)[start[np.unique(rims, return_index=True)[1]]]
    closed = whole**2 <= 4.0 * np.pi * most * area
    if not closed.any():
        return mesh
    # By the length of the edges, so that more vertices on one side do not draw the middle there.
    between = lengths[:, None] * (mesh.vertices[start] + mesh.vertices[end]) / 2.0
    middles = np.stack([np.bincount(rims, weights=each) for each in between.T], axis=1) / whole[:, None]
    number = len(mesh.vertices) + np.cumsum(closed) - 1
    used = closed[rims]
    fans = np.stack([end[used], start[used], number[rims[used]]], axis=1)
    return Mesh(np.concatenate([mesh.vertices, middles[closed]]), np.concatenate([mesh.faces, fans]))


def _open_sides(faces: Ints, sides: HalfEdges) -> tuple[Ints, Ints]:
    """The ends of the sides whose edge no other face has, as their faces run."""
    alone = sides.order[sides.first[sides.sheets == 1]]
    return faces.ravel()[alone], faces[:, [1, 2, 0]].ravel()[alone]


def _rims(start: Ints, end: Ints, vertices: int) -> Ints:
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
    rims = np.full(len(start), -1, dtype=np.int64)
    _, first, inverse = np.unique(part[start[good]], return_index=True, return_inverse=True)
    lowest = np.full(len(first), vertices)
    np.minimum.at(lowest, inverse, start[good])
    rims[good] = np.argsort(np.argsort(lowest))[inverse]
    return rims
