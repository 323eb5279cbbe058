"""Simplification: fewer faces by quadric error, or by vertex clustering where quadric collapses fail."""

import fast_simplification
import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh

MOST_WORK = 1e8
"""Quadric collapses go round and round a vertex of very many neighbours; their work grows as the sum of all
squared valences, and past this number, some seconds, vertices are clustered instead."""

SHORT = 1.1
"""Where quadric collapses stop at more than this many times the wanted faces, vertices are clustered too."""

_HALVINGS = 30


def decimate(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Simplified by quadric error (Garland and Heckbert 1997) to a share of its faces.

    The seed settles the order of the faces, and with it which of about equal collapses comes first. Where
    that would take too long (`MOST_WORK`), or stops short (`SHORT`), it is `cluster_vertices` instead: a rule
    on the mesh, not on a clock.

    Parameters
    ----------
    mesh : Mesh
    amount : float
        Share of the faces to keep, in (0, 1].
    seed : int

    Raises
    ------
    NoTrianglesError
        Nothing is left of a mesh of very few faces.
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
    """The vertices of each cell of a cubic grid become one, at their mean (Rossignac and Borrel 1993).

    The cells' size is the one, found by halving, that leaves nearest to `faces` distinct faces; the seed
    shifts the grid.

    Raises
    ------
    NoTrianglesError
        Every size leaves none.
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
    """Vertices and distinct faces over the cells of one size."""
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
    """Raise a ParameterError unless the amount lies within both, or at one of them."""
    if not least <= amount <= most:
        raise ParameterError(f"an amount of {amount} lies outside {least} to {most}")


def diagonal(mesh: Mesh) -> float:
    """Of the bounding box along the mesh's own axes."""
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def simplify(mesh: Mesh, vertices: int) -> Mesh:
    """A mesh in its normal frame with about so many vertices, by quadric error (Garland and Heckbert 1997).

    Coordinates are rounded to six decimals first: on flat parts every collapse costs nothing, and the last
    bits, which change with the pose, would choose among them.
    """
    points, faces = fast_simplification.simplify(
        np.round(mesh.vertices, 6),
        mesh.faces.astype(np.int32),
        target_reduction=1.0 - vertices / len(mesh.vertices),
    )
    return clean(Mesh(points, faces)).mesh
