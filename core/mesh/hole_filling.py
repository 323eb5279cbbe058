"""Hole filling: closes boundary loops by fans of triangles.

Around a hole, or where a limb is cut off, geodesics detour and the Laplacian's domain ends; a closed surface
has the distances of the complete shape. A boundary loop is closed by a fan around its centre if the disc that
it can bound is small beside the surface. The boundary of a sheet or of a single triangle stays open: a planar
surface is no larger than the disc of its boundary loop.
"""

import numpy as np

from core.mesh.boundary import boundary_half_edges, boundary_loops
from core.mesh.cleaning import component_areas
from core.mesh.mesh import Mesh


def fill_holes(mesh: Mesh, most: float) -> Mesh:
    """The mesh with its holes closed: each loop gets a centre vertex, and a face from each edge to it.

    A boundary loop is a simple closed chain of edges that have one face each. A loop of length l bounds a
    disc of area at most l^2 / 4 pi.

    Parameters
    ----------
    mesh : Mesh
        Its coincident vertices are merged.
    most : float
        A loop is closed if its disc is at most this share of the area of its connected component; >= 0.

    Returns
    -------
    Mesh
        The given mesh if no loop is closed; else a mesh with the new vertices and faces at the end.
    """
    edges = boundary_half_edges(mesh.faces, mesh.half_edges)
    loops = boundary_loops(edges, len(mesh.vertices))
    on = loops >= 0
    if not on.any():
        return mesh
    (start, end), loops = edges[on].T, loops[on]
    lengths = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    whole = np.bincount(loops, weights=lengths)
    area = component_areas(mesh)[start[np.unique(loops, return_index=True)[1]]]
    closed = whole**2 <= 4.0 * np.pi * most * area
    if not closed.any():
        return mesh
    # Weighted by edge length: denser vertices on one side do not move the centre.
    between = lengths[:, None] * (mesh.vertices[start] + mesh.vertices[end]) / 2.0
    middles = np.stack([np.bincount(loops, weights=each) for each in between.T], axis=1) / whole[:, None]
    number = len(mesh.vertices) + np.cumsum(closed) - 1
    used = closed[loops]
    fans = np.stack([end[used], start[used], number[loops[used]]], axis=1)
    return Mesh(np.concatenate([mesh.vertices, middles[closed]]), np.concatenate([mesh.faces, fans]))
