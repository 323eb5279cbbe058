"""Perturbations of a mesh: noise, missing parts, other tessellations, separate pieces.

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
from core.mesh.simplification import check_amount, diagonal
from core.mesh.subdivision import edge_table, refine, split_faces

DISCS = 5
PARTS = 8

LARGE_FACE = 0.01
"""A mesh with a face above this share of the area is subdivided before a share of the area is removed."""

SPLIT_TO = 2000
"""Number of vertices for this subdivision."""


def add_noise(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Isotropic Gaussian noise on every vertex.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Standard deviation of each coordinate over the diagonal of the bounding box, >= 0.
    seed : int
    """
    check_amount(amount, 0.0, np.inf)
    deviation = amount * diagonal(mesh)
    return Mesh(
        mesh.vertices + deviation * np.random.default_rng(seed).normal(size=mesh.vertices.shape), mesh.faces
    )


def remove_discs(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Holes: remove `DISCS` geodesic discs of one radius, which may overlap.

    The centres are drawn by area. The faces geodesically nearest to them are removed, until the removed area
    is within half of the largest face of the wanted area (see `LARGE_FACE`).

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Share of the area to remove, in [0, 1).
    seed : int
    """
    mesh = _with_small_faces(mesh)
    nearest = _distances_to(mesh, _centres(mesh, DISCS, seed)).min(axis=0)
    return _without(mesh, nearest[mesh.faces].mean(axis=1), amount)


def cut_part(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Cut one part away: remove all faces with a centroid beyond a plane of uniformly random direction.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Share of the area beyond the plane, in [0, 1), exact to within half of the largest face.
    seed : int
    """
    mesh = _with_small_faces(mesh)
    direction = np.random.default_rng(seed).normal(size=3)
    return _without(mesh, -(mesh.vertices[mesh.faces].mean(axis=1) @ direction), amount)


def subdivide(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Split random edges at their midpoints; the surface stays, its faces are cut into two, three or four.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Share of the edges that are split, in [0, 1]; 1 cuts every face into four.
    seed : int
    """
    check_amount(amount, 0.0, 1.0)
    edges, of_face = edge_table(mesh.faces)
    drawn = np.random.default_rng(seed).permutation(len(edges))[: round(amount * len(edges))]
    middle = np.full(len(edges), -1, dtype=np.int64)
    middle[drawn] = len(mesh.vertices) + np.arange(len(drawn))
    vertices = np.concatenate([mesh.vertices, mesh.vertices[edges[drawn]].mean(axis=1)])
    return Mesh(vertices, split_faces(mesh.faces, middle[of_face], vertices))


def make_soup(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Triangle soup: every face gets its own three vertices and shrinks towards its centroid.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Mean relative shrinkage of a face, in [0, 0.5]; the shrinkage of each face is uniform between half and
        one and a half times the mean. At 0 vertices still coincide, and cleaning merges them again.
    seed : int
    """
    check_amount(amount, 0.0, 0.5)
    corners = mesh.vertices[mesh.faces]
    lost = amount * np.random.default_rng(seed).uniform(0.5, 1.5, size=(len(corners), 1, 1))
    corners = corners + lost * (corners.mean(axis=1, keepdims=True) - corners)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def separate_parts(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Separate the surface into `PARTS` pieces that move independently.

    Centres are drawn by area; a face belongs to the piece of the geodesically nearest centre.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Distance that each piece moves, in a random direction, over the diagonal of the bounding box; >= 0.
    seed : int
    """
    check_amount(amount, 0.0, np.inf)
    distances = _distances_to(mesh, _centres(mesh, PARTS, seed))
    part = np.argmin(distances[:, mesh.faces].sum(axis=2), axis=0)
    moves = np.random.default_rng([seed, 1]).normal(size=(PARTS, 3))
    moves *= amount * diagonal(mesh) / np.linalg.norm(moves, axis=1, keepdims=True)
    keys, corner = np.unique(part[:, None] * len(mesh.vertices) + mesh.faces, return_inverse=True)
    of_part, vertex = np.divmod(keys, len(mesh.vertices))
    return Mesh(mesh.vertices[vertex] + moves[of_part], corner.reshape(-1, 3))


def _with_small_faces(mesh: Mesh) -> Mesh:
    areas = face_areas(mesh.vertices, mesh.faces)
    return refine(mesh, SPLIT_TO) if areas.max() > LARGE_FACE * areas.sum() else mesh


def _centres(mesh: Mesh, count: int, seed: int) -> Ints:
    """Corners of faces drawn by area, shape (count,)."""
    areas = face_areas(mesh.vertices, mesh.faces)
    drawn = np.random.default_rng(seed).choice(len(areas), size=count, p=areas / areas.sum())
    return np.asarray(mesh.faces[drawn, 0])


def _distances_to(mesh: Mesh, centres: Ints) -> Floats:
    """Path lengths on the edge graph, with bridges, from each centre to each vertex, shape (c, n)."""
    return np.asarray(dijkstra(edge_graph(mesh), indices=centres))


def _without(mesh: Mesh, order: Floats, share: float) -> Mesh:
    """Remove the faces of lowest `order`, shape (f,), that have the given share of the area."""
    check_amount(share, 0.0, np.nextafter(1.0, 0.0))
    first = np.argsort(order, kind="stable")
    gone = np.cumsum(np.concatenate([[0.0], face_areas(mesh.vertices, mesh.faces[first])]))
    count = int(np.argmin(np.abs(gone[:-1] - share * gone[-1])))
    used, faces = np.unique(mesh.faces[np.sort(first[count:])], return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3))
