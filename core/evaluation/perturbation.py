"""Perturbations of a mesh: holes, a part cut away, another tessellation.

Each function takes a mesh, an amount and a seed; the same three give the same mesh to the last bit. An amount
out of range raises a ParameterError. Coincident vertices count as different: clean the mesh first
(`core.mesh.cleaning.clean`) if its faces should stay connected.
"""

import numpy as np
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.graph.edge_graph import edge_graph
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.mesh.simplification import check_amount
from core.mesh.subdivision import edge_table, refine, split_faces

DISCS = 5
"""Number of discs that `remove_discs` removes."""

LARGE_FACE = 0.01
"""A mesh with a face above this share of the area is subdivided before a share of the area is removed."""

SPLIT_TO = 2000
"""Number of vertices for this subdivision."""


def remove_discs(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Remove `DISCS` geodesic discs of one radius, which may overlap.

    The centres are drawn by area. The faces geodesically nearest to them are removed, until the removed area
    is within half of the largest face of the wanted area (see `LARGE_FACE`). `amount` is the share of the
    area to remove, in [0, 1).
    """
    mesh = _with_small_faces(mesh)
    nearest = distances_from(mesh, drawn_centres(mesh, DISCS, seed)).min(axis=0)
    return _without(mesh, nearest[mesh.faces].mean(axis=1), amount)


def cut_part(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Cut one part away: remove all faces with a centroid beyond a plane of uniformly random direction.

    `amount` is the share of the area beyond the plane, in [0, 1), exact to within half of the largest face.
    """
    mesh = _with_small_faces(mesh)
    direction = np.random.default_rng(seed).normal(size=3)
    return _without(mesh, -(mesh.vertices[mesh.faces].mean(axis=1) @ direction), amount)


def subdivide(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Split random edges at their midpoints; the surface stays, its faces are cut into two, three or four.

    `amount` is the share of the edges that are split, in [0, 1]; 1 cuts every face into four.
    """
    check_amount(amount, 0.0, 1.0)
    edges, of_face = edge_table(mesh.faces)
    drawn = np.random.default_rng(seed).permutation(len(edges))[: round(amount * len(edges))]
    middle = np.full(len(edges), -1, dtype=np.int64)
    middle[drawn] = len(mesh.vertices) + np.arange(len(drawn))
    vertices = np.concatenate([mesh.vertices, mesh.vertices[edges[drawn]].mean(axis=1)])
    return Mesh(vertices, split_faces(mesh.faces, middle[of_face], vertices))


def drawn_centres(mesh: Mesh, count: int, seed: int) -> Ints:
    """Return corners of faces that are drawn by area, shape (count,)."""
    areas = face_areas(mesh.vertices, mesh.faces)
    drawn = np.random.default_rng(seed).choice(len(areas), size=count, p=areas / areas.sum())
    return np.asarray(mesh.faces[drawn, 0])


def distances_from(mesh: Mesh, centres: Ints) -> Floats:
    """Return lengths of paths on the edge graph, from each of c centres to each vertex, shape (c, n)."""
    return np.asarray(dijkstra(edge_graph(mesh), indices=centres))


def _with_small_faces(mesh: Mesh) -> Mesh:
    areas = face_areas(mesh.vertices, mesh.faces)
    return refine(mesh, SPLIT_TO) if areas.max() > LARGE_FACE * areas.sum() else mesh


def _without(mesh: Mesh, order: Floats, share: float) -> Mesh:
    """Remove the faces of lowest `order`, shape (f,), that have the given share of the area."""
    check_amount(share, 0.0, np.nextafter(1.0, 0.0))
    first = np.argsort(order, kind="stable")
    removed = np.cumsum(np.concatenate([[0.0], face_areas(mesh.vertices, mesh.faces[first])]))
    count = int(np.argmin(np.abs(removed[:-1] - share * removed[-1])))
    used, faces = np.unique(mesh.faces[np.sort(first[count:])], return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3))
