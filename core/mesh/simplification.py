"""Simplification: fewer faces by quadric error, or by vertex clustering where quadric collapses fail."""

import fast_simplification
import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.mesh.cleaning import clean, face_areas
from core.mesh.edge_contraction import contract_edges
from core.mesh.mesh import Mesh

MOST_WORK = 1e8
"""The work of quadric collapses grows as the sum of the squared valences. Above this number (some seconds)
vertices are clustered instead."""

SHORT = 1.1
"""Vertices are clustered if quadric collapses leave more than this many times the wanted faces."""

CONNECTED = 1.5
"""Least number of faces per vertex of a connected surface: a closed one has 2, a soup of triangles 1/3.
Without common edges a collapse removes a triangle."""

FINENESS = 4
"""Connected meshes of more than this many vertices for each wanted one are contracted before quadric
collapses, whose time and memory grow with the mesh."""

_HALVINGS = 30


def decimate(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Simplify to a share of the faces by quadric error (Garland and Heckbert 1997).

    If the collapses would take too long (`MOST_WORK`) or stop too early (`SHORT`), `cluster_vertices` is used
    instead; the rule depends on the mesh only, not on a clock.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Share of the faces to keep, in (0, 1].
    seed : int
        Shuffles the faces, which decides between collapses of nearly equal cost.

    Raises
    ------
    ParameterError
        The amount is outside (0, 1].
    NoTrianglesError
        No face is left of a mesh of very few faces.
    """
    check_amount(amount, np.finfo(float).tiny, 1.0)
    wanted = max(4, round(amount * len(mesh.faces)))
    if wanted >= len(mesh.faces):
        return mesh
    valences = np.bincount(mesh.faces.ravel()).astype(np.float64)
    if float(valences @ valences) <= MOST_WORK:
        order = np.random.default_rng(seed).permutation(len(mesh.faces))
        points, faces = fast_simplification.simplify(
            mesh.vertices.copy(), mesh.faces[order].astype(np.int32), target_count=wanted
        )
        if 0 < len(faces) <= SHORT * wanted:
            return Mesh(points, faces)
    return cluster_vertices(mesh, wanted, seed)


def cluster_vertices(mesh: Mesh, faces: int, seed: int) -> Mesh:
    """Merge the vertices in each cell of a cubic grid at their mean (Rossignac and Borrel 1993).

    Parameters
    ----------
    mesh : Mesh
    faces : int
        Wanted number of distinct faces; bisection finds the cell size that comes nearest.
    seed : int
        Shifts the grid.

    Raises
    ------
    NoTrianglesError
        No cell size leaves a face.
    """
    shift = np.random.default_rng(seed).random(3)
    low = mesh.vertices.min(axis=0)
    most, least = diagonal(mesh), 1e-5 * diagonal(mesh)
    best = _clustered(mesh, low, least, shift)
    for _ in range(_HALVINGS):
        size = float(np.sqrt(least * most))
        found = _clustered(mesh, low, size, shift)
        if len(found[1]) > 0 and abs(len(found[1]) - faces) < abs(len(best[1]) - faces):
            best = found
        least, most = (size, most) if len(found[1]) > faces else (least, size)
    return Mesh(*best)


def _clustered(mesh: Mesh, low: Floats, size: float, shift: Floats) -> tuple[Floats, Ints]:
    """Vertices, shape (n, 3), and distinct faces, shape (f, 3), after clustering with one cell size."""
    cells = np.floor((mesh.vertices - low) / size + shift).astype(np.int64)
    width = int(cells.max()) + 1
    _, cell = np.unique((cells[:, 0] * width + cells[:, 1]) * width + cells[:, 2], return_inverse=True)
    count = np.bincount(cell)
    points = np.stack([np.bincount(cell, weights=axis) / count for axis in mesh.vertices.T], axis=1)
    faces = cell[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return points, faces[np.sort(first)]


def check_amount(amount: float, least: float, most: float) -> None:
    """Raise a ParameterError unless least <= amount <= most."""
    if not least <= amount <= most:
        raise ParameterError(f"an amount of {amount} lies outside {least} to {most}")


def diagonal(mesh: Mesh) -> float:
    """Length of the diagonal of the axis-aligned bounding box."""
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def simplify(mesh: Mesh, vertices: int) -> Mesh:
    """Simplify to about `vertices` vertices by quadric error (Garland and Heckbert 1997), and clean.

    Coordinates are rounded to six decimals first: every collapse on a planar part costs 0, and the last bits,
    which change with the pose, would decide between them. Large connected meshes are contracted before
    (`contract_edges`).

    Parameters
    ----------
    mesh : Mesh
        In its normal frame.
    vertices : int
        Wanted number, less than the mesh has.
    """
    points, faces = np.round(mesh.vertices, 6), mesh.faces
    most = FINENESS * vertices
    if len(points) > most and len(faces) >= CONNECTED * len(points):
        points, faces = contract_edges(points, faces, most)
        # Contracted vertices of a flat part are exactly coplanar: the quadric is then singular, its minimum
        # may be far away, and faces flip. Rounding to a hundredth of an even mesh's sides prevents it.
        step = 0.01 * np.sqrt(float(face_areas(points, faces).sum()) / most)
        points = np.round(points / step) * step
    points, faces = fast_simplification.simplify(
        points, faces.astype(np.int32), target_reduction=1.0 - vertices / len(points)
    )
    return clean(Mesh(points, faces)).mesh
