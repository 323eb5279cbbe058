"""Geodesic errors of correspondences whose truth is known: of made bodies, and of template vertices."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.dense.functional_maps import FINE, Basis, FunctionalMap, basis, functional_map
from core.embedding import Embedding
from core.errors import ParameterError
from core.gallery.bodies import Body, individual_partners, make_body
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import geodesics
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.pipeline import Pipeline

MOST_ERROR = 0.06
"""Largest accepted mean geodesic error of a class of made bodies, over the square root of the area."""

REMESHED = 2100
"""Number of vertices of a remeshed body; it differs from `core.gallery.bodies.VERTICES`."""

MEASURED = 400
"""Number of template vertices at which errors are measured."""


@dataclass(frozen=True)
class PairErrors:
    """Errors of the match of two poses, or of two individuals, `first` and `second`, and its CC.

    `samples` and `vertices` are mean geodesic errors over the square root of the area, each the least over
    the body's symmetries: of the matched samples, and of the dense correspondence of all vertices of the
    first. `symmetry` is that of the latter, a row of `Body.partners`; `direct` is its error where the body's
    own left must stay left, of symmetry 0.
    """

    first: int
    second: int
    cc: float
    samples: float
    vertices: float
    symmetry: int
    direct: float


@dataclass(frozen=True)
class BodyErrors:
    """Errors of all ordered pairs of poses of the individual `body`, or of individuals if `body` is None."""

    label: str
    body: int | None
    pairs: tuple[PairErrors, ...]

    def mean(self, field: str) -> float:
        """Return the mean over the pairs of one field of `PairErrors`."""
        return float(np.mean([getattr(pair, field) for pair in self.pairs]))


@dataclass(frozen=True, eq=False)
class PreparedMesh:
    """A mesh that is ready to be matched."""

    embedding: Embedding
    basis: Basis

    @classmethod
    def of(cls, mesh: Mesh, pipeline: Pipeline) -> "PreparedMesh":
        """Embed a mesh and compute its basis."""
        return cls(pipeline.embed(mesh), basis(mesh, FINE))


def surface_distances(body: Body) -> Floats:
    """Return geodesic distances between all vertices of a body at rest, over the root of its area, (n, n).

    Poses bend joints and stretch little, so the distances of every pose differ by a few per cent.
    """
    area = float(face_areas(body.rest.vertices, body.rest.faces).sum())
    lengths = np.asarray(dijkstra(edge_graph(body.rest)))
    return np.asarray(np.minimum(lengths, lengths.T) / np.sqrt(area))


def symmetric_error(distances: Floats, partners: Ints, vertices: Ints, targets: Ints) -> tuple[float, int]:
    """Return the mean distance of mapped vertices from the true ones, and the symmetry that minimises it.

    `distances`, shape (m, m), are between the vertices of the second mesh, and `partners`, shape (g, n),
    those of `Body.partners`. `vertices` of the first mesh are mapped to `targets` of the second, shapes (p,).
    """
    errors = distances[targets, partners[:, vertices]].mean(axis=1)
    return float(errors.min()), int(errors.argmin())


def study_body(
    label: str, number: int, poses: int, parameters: Parameters, *, remeshed: bool = False
) -> BodyErrors:
    """Match all ordered pairs of poses 0 .. `poses` - 1 of a body, and compare them with the truth.

    The body is that of the gallery's class `label` with a number >= 0. If `remeshed`, the second pose has
    another mesh, so that identical triangles do not help: the truth is then known to within half an edge.
    """
    body = make_body(label, number)
    second = make_body(label, number, vertices=REMESHED) if remeshed else body
    truth, distances = body.partners(second), surface_distances(second)
    pipeline = Pipeline(parameters)
    firsts = [PreparedMesh.of(body.posed(pose), pipeline) for pose in range(poses)]
    seconds = [PreparedMesh.of(second.posed(pose), pipeline) for pose in range(poses)] if remeshed else firsts
    pairs = permutations(range(poses), 2)
    errors = [_pair_errors(i, j, firsts[i], seconds[j], truth, distances, pipeline) for i, j in pairs]
    return BodyErrors(label, number, tuple(errors))


def study_individuals(label: str, count: int, parameters: Parameters) -> BodyErrors:
    """Match all ordered pairs of individuals 0 .. `count` - 1 of a class; individual i is in pose i."""
    bodies = [make_body(label, number) for number in range(count)]
    pipeline = Pipeline(parameters)
    prepared = [PreparedMesh.of(body.posed(number), pipeline) for number, body in enumerate(bodies)]
    distances = [surface_distances(body) for body in bodies]
    errors = []
    for i, j in permutations(range(count), 2):
        truth = individual_partners(bodies[i], bodies[j])
        errors.append(_pair_errors(i, j, prepared[i], prepared[j], truth, distances[j], pipeline))
    return BodyErrors(label, None, tuple(errors))


def _pair_errors(
    i: int,
    j: int,
    first: PreparedMesh,
    second: PreparedMesh,
    truth: Ints,
    distances: Floats,
    pipeline: Pipeline,
) -> PairErrors:
    """Return the errors of one ordered pair, from the truth and the distances on the second surface."""
    match = pipeline.match(first.embedding, second.embedding)
    matched = _vertices(first.embedding, second.embedding, match.correspondence.astype(np.int64))
    samples, _ = symmetric_error(distances, truth, matched[:, 0], matched[:, 1])
    _, targets = dense_map(first, second, pipeline)
    everywhere = np.arange(truth.shape[1])
    vertices, symmetry = symmetric_error(distances, truth, everywhere, targets)
    direct, _ = symmetric_error(distances, truth[:1], everywhere, targets)
    return PairErrors(i, j, match.cc, samples, vertices, symmetry, direct)


def _vertices(first: Embedding, second: Embedding, pairs: Ints) -> Ints:
    """Return the vertices of paired samples, shape (p, 2)."""
    return np.stack([first.vertices[pairs[:, 0]], second.vertices[pairs[:, 1]]], axis=1).astype(np.int64)


def dense_map(first: PreparedMesh, second: PreparedMesh, pipeline: Pipeline) -> tuple[FunctionalMap, Ints]:
    """Return the map of two meshes, and the vertex of the second for each of n of the first, shape (n,)."""
    candidates, mirrored = pipeline.correspondences(first.embedding, second.embedding)
    pairs = [_vertices(first.embedding, second.embedding, samples) for samples in candidates]
    found = functional_map(first.basis, second.basis, pairs, mirrored)
    return found, found.partners(first.basis, second.basis)


@dataclass(frozen=True, eq=False)
class KnownMesh(PreparedMesh):
    """A clean mesh whose correspondence with a template is known.

    `truth`, shape (g, t), has for each measured vertex of the template the vertex of the mesh that is it, and
    if it is known, in a second row, the vertex that is its mirror image. `distances`, float32 of shape
    (g, t, n), are geodesic, of all vertices from those, over the root of the area.
    """

    mesh: Mesh
    truth: Ints
    distances: Floats


@dataclass(frozen=True)
class TruthErrors:
    """Mean geodesic errors of the dense correspondence of two meshes, over the root of the area.

    `direct` is from the true vertices: the left of the first body is the left of the second. `symmetric` is
    the lesser of the errors from these and from their mirror images.
    """

    direct: float
    symmetric: float


def measured_vertices(template: int, seed: int) -> Ints:
    """Draw the vertices of a template of so many vertices at which errors are measured, ascending."""
    return np.sort(np.random.default_rng(seed).permutation(template)[:MEASURED])


def known_mesh(mesh: Mesh, truth: Ints, pipeline: Pipeline) -> KnownMesh:
    """Prepare a mesh with the vertices, in the order of its file, that are those of a template.

    `truth`, int64 of shape (g, t), is that of `KnownMesh` in the numbers of the mesh as its file has it.
    Raise ParameterError if a vertex is none of the mesh, and CoreError if the mesh cannot be embedded.
    """
    if truth.size == 0 or truth.min() < 0 or truth.max() >= len(mesh.vertices):
        raise ParameterError(f"the truth names vertices that are none of the mesh's {len(mesh.vertices)}")
    cleaned = clean(mesh).mesh
    nearest = np.asarray(cKDTree(cleaned.vertices).query(mesh.vertices[truth])[1], dtype=np.int64)
    sources, rows = np.unique(nearest, return_inverse=True)
    lengths = geodesics(edge_graph(cleaned), sources, np.arange(len(cleaned.vertices)))
    area = float(face_areas(cleaned.vertices, cleaned.faces).sum())
    distances = (lengths.T / np.sqrt(area)).astype(np.float32)[rows.reshape(nearest.shape)]
    return KnownMesh(pipeline.embed(cleaned), basis(cleaned, FINE), cleaned, nearest, distances)


def truth_errors(first: KnownMesh, second: KnownMesh, targets: Ints) -> TruthErrors:
    """Return the errors of a map from the n vertices of the first mesh to those of the second, shape (n,)."""
    ends = targets[first.truth[0]]
    errors = second.distances[:, np.arange(len(ends)), ends].mean(axis=1)
    return TruthErrors(float(errors[0]), float(errors.min()))


def drawn_pairs(
    classes: Sequence[str], templates: Sequence[str], count: int, seed: int
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Draw at most `count` ordered pairs of shapes of one class, and of two classes, that share a template.

    No pair comes twice. `classes` and `templates` are those of each shape.
    """
    random = np.random.default_rng(seed)
    together = [(i, j) for i, j in permutations(range(len(classes)), 2) if templates[i] == templates[j]]
    kinds = (
        [pair for pair in together if (classes[pair[0]] == classes[pair[1]]) is same]
        for same in (True, False)
    )
    same, different = (sorted(pairs[k] for k in random.permutation(len(pairs))[:count]) for pairs in kinds)
    return same, different
