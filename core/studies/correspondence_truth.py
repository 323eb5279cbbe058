"""Accuracy of correspondences of real meshes, whose vertices are known on a template."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.dense.functional_maps import Basis, basis, extend
from core.embedding import Embedding
from core.errors import ParameterError
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import geodesics
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline

MEASURED = 400
"""Number of template vertices at which errors are measured."""


@dataclass(frozen=True, eq=False)
class KnownMesh:
    """A mesh whose correspondence with a template is known, ready to be matched.

    Attributes
    ----------
    mesh : Mesh
        Clean.
    truth : int64, shape (g, t)
        For each measured vertex of the template the vertex of the mesh that is it, and if it is known, in a
        second row, the vertex that is its mirror image.
    distances : float32, shape (g, t, n)
        Geodesic distances of all vertices of the mesh from those of `truth`, over the root of its area.
    embedding : Embedding
        Of the clean mesh.
    basis : Basis
        Of the clean mesh.
    """

    mesh: Mesh
    truth: Ints
    distances: Floats
    embedding: Embedding
    basis: Basis


@dataclass(frozen=True)
class TruthErrors:
    """Mean geodesic errors of the dense correspondence of two meshes, over the root of the area.

    Attributes
    ----------
    direct : float
        From the true vertices: the left of the first body is the left of the second.
    symmetric : float
        The lesser of the errors from the true vertices and from their mirror images.
    """

    direct: float
    symmetric: float


def measured_vertices(template: int, seed: int) -> Ints:
    """The vertices of a template of so many vertices at which errors are measured, ascending, `MEASURED`."""
    chosen = np.random.default_rng(seed).permutation(template)[:MEASURED]
    return np.sort(chosen)


def known_mesh(mesh: Mesh, truth: Ints, pipeline: Pipeline) -> KnownMesh:
    """A mesh with the vertices, in the order of its file, that are those of a template.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices, as its file has them.
    truth : int64, shape (g, t)
        See `KnownMesh`.
    pipeline : Pipeline

    Raises
    ------
    ParameterError
        A vertex is none of the mesh.
    CoreError
        The mesh cannot be embedded.
    """
    if truth.size == 0 or truth.min() < 0 or truth.max() >= len(mesh.vertices):
        raise ParameterError(f"the truth names vertices that are none of the mesh's {len(mesh.vertices)}")
    cleaned = clean(mesh).mesh
    places = np.asarray(cKDTree(cleaned.vertices).query(mesh.vertices[truth])[1], dtype=np.int64)
    targets, rows = np.unique(places, return_inverse=True)
    lengths = geodesics(edge_graph(cleaned), targets, np.arange(len(cleaned.vertices)))
    area = float(face_areas(cleaned.vertices, cleaned.faces).sum())
    distances = (lengths.T / np.sqrt(area)).astype(np.float32)[rows.reshape(places.shape)]
    return KnownMesh(cleaned, places, distances, pipeline.embed(cleaned), basis(cleaned))


def corresponding_vertices(first: KnownMesh, second: KnownMesh, pipeline: Pipeline) -> Ints:
    """The vertex of the second mesh for each vertex of the first, by the dense correspondence."""
    found, mirrored = pipeline.correspondences(first.embedding, second.embedding)
    vertices = first.embedding.vertices.astype(np.int64), second.embedding.vertices.astype(np.int64)
    pairs = [np.stack([vertices[0][one[:, 0]], vertices[1][one[:, 1]]], axis=1) for one in found]
    return extend(first.basis, second.basis, pairs, mirrored)


def truth_errors(first: KnownMesh, second: KnownMesh, found: Ints) -> TruthErrors:
    """The errors of a map from the n vertices of the first mesh to those of the second, int64, shape (n,)."""
    ends = found[first.truth[0]]
    errors = second.distances[:, np.arange(len(ends)), ends].mean(axis=1)
    return TruthErrors(float(errors[0]), float(errors.min()))


def drawn_pairs(
    classes: Sequence[str], templates: Sequence[str], count: int, seed: int
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Ordered pairs of shapes that share a template, drawn without repetition.

    Parameters
    ----------
    classes, templates : sequence of str
        Of each shape.
    count : int
        The most pairs of each kind; all pairs are taken where there are fewer.
    seed : int

    Returns
    -------
    list of pairs of one class, list of pairs of two classes
    """
    random = np.random.default_rng(seed)
    together = [
        (i, j)
        for i in range(len(classes))
        for j in range(len(classes))
        if i != j and templates[i] == templates[j]
    ]

    def drawn(fits: Callable[[int, int], bool]) -> list[tuple[int, int]]:
        pairs = [pair for pair in together if fits(*pair)]
        return sorted(pairs[k] for k in random.permutation(len(pairs))[:count])

    return (
        drawn(lambda i, j: classes[i] == classes[j]),
        drawn(lambda i, j: classes[i] != classes[j]),
    )
