"""Accuracy of correspondences of made bodies: poses of one body, and individuals of one class."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.dense.functional_maps import Basis, basis, extend
from core.embedding import Embedding
from core.gallery.bodies import Body, individual_partners, make_body
from core.graph.edge_graph import edge_graph
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.pipeline import Pipeline

MOST_ERROR = 0.06
"""Largest accepted mean geodesic error of a class, over the square root of the area."""


@dataclass(frozen=True)
class PairErrors:
    """Errors of the match of two poses, or of two individuals.

    Attributes
    ----------
    first, second : int
        The poses or individuals; each vertex of the first is mapped to a vertex of the second.
    cc : float
        CC of the two poses.
    samples, vertices : float
        Mean geodesic error of the matched samples, and of the dense correspondence of all vertices, over the
        square root of the area; each is the least over the body's symmetries.
    symmetry : int
        The symmetry of the least error of the dense correspondence: a row of `Body.partners`.
    direct : float
        The error of the dense correspondence where the body's own left must stay left: of symmetry 0.
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
    """Errors of all ordered pairs of a body's poses, or of individuals of a class.

    Attributes
    ----------
    label : str
    body : int or None
        The individual whose poses are matched; None for individuals.
    pairs : tuple of PairErrors
    """

    label: str
    body: int | None
    pairs: tuple[PairErrors, ...]

    @property
    def samples(self) -> float:
        """Mean over the pairs."""
        return float(np.mean([pair.samples for pair in self.pairs]))

    @property
    def vertices(self) -> float:
        """Mean over the pairs."""
        return float(np.mean([pair.vertices for pair in self.pairs]))

    @property
    def direct(self) -> float:
        """Mean over the pairs."""
        return float(np.mean([pair.direct for pair in self.pairs]))


REMESHED = 2100
"""Number of vertices of the second mesh; it differs from `core.gallery.bodies.VERTICES`."""


def surface_distances(body: Body) -> Floats:
    """Geodesic distances between all vertices of a body at rest, over the root of its area, shape (n, n).

    Poses bend joints and stretch little, so the distances of every pose differ by a few per cent.
    """
    area = float(face_areas(body.rest.vertices, body.rest.faces).sum())
    found = np.asarray(dijkstra(edge_graph(body.rest)))
    return np.asarray(np.minimum(found, found.T) / np.sqrt(area))


def symmetric_error(distances: Floats, partners: Ints, vertices: Ints, found: Ints) -> tuple[float, int]:
    """Mean distance of the mapped vertices from the true ones, and the symmetry that minimises it.

    Parameters
    ----------
    distances : float64, shape (m, m)
        Geodesic distances between the vertices of the other mesh.
    partners : int64, shape (g, n)
        True correspondences, one row for each symmetry, from `Body.partners`.
    vertices, found : int64, shape (p,)
        Vertices of one pose, and the vertices of the other pose to which they are mapped.
    """
    errors = distances[found, partners[:, vertices]].mean(axis=1)
    return float(errors.min()), int(errors.argmin())


def study_body(
    label: str, number: int, poses: int, parameters: Parameters, *, remeshed: bool = False
) -> BodyErrors:
    """Match all ordered pairs of poses of a body, and compare the results with the true correspondence.

    Parameters
    ----------
    label : str
        A class of the gallery.
    number : int
        The individual, >= 0.
    poses : int
        Poses 0 .. `poses` - 1, at least 2.
    parameters : Parameters
        Parameters of the pipeline.
    remeshed : bool
        Whether the second pose has another mesh, so that identical triangles do not help. The true
        correspondence is then known to within half an edge.
    """
    body = make_body(label, number)
    other = make_body(label, number, vertices=REMESHED) if remeshed else body
    truth, distances = body.partners(other), surface_distances(other)
    pipeline = Pipeline(parameters)
    sides = [_Side.of(side, poses, pipeline) for side in ([body, other] if remeshed else [body])]
    here, there = sides[0], sides[-1]
    errors = [
        _pair_errors((first, second), (here, there), (truth, distances), pipeline)
        for first, second in permutations(range(poses), 2)
    ]
    return BodyErrors(label, number, tuple(errors))


def study_individuals(label: str, count: int, parameters: Parameters) -> BodyErrors:
    """Match all ordered pairs of individuals of a class, each in a pose of its own, and measure the errors.

    Parameters
    ----------
    label : str
        A class of the gallery.
    count : int
        Individuals 0 .. `count` - 1, at least 2; number i is in pose i.
    parameters : Parameters
        Parameters of the pipeline.
    """
    bodies = [make_body(label, number) for number in range(count)]
    pipeline = Pipeline(parameters)
    side = _Side.of_meshes([body.posed(number) for number, body in enumerate(bodies)], pipeline)
    distances = [surface_distances(body) for body in bodies]
    errors = [
        _pair_errors(
            (first, second),
            (side, side),
            (individual_partners(bodies[first], bodies[second]), distances[second]),
            pipeline,
        )
        for first, second in permutations(range(count), 2)
    ]
    return BodyErrors(label, None, tuple(errors))


def _pair_errors(
    numbers: tuple[int, int], sides: tuple["_Side", "_Side"], known: tuple[Ints, Floats], pipeline: Pipeline
) -> PairErrors:
    """The errors of one ordered pair, from the truth and the distances on the second surface."""
    (first, second), (here, there), (truth, distances) = numbers, sides, known
    one, two = here.embeddings[first], there.embeddings[second]
    match = pipeline.match(one, two)
    matched = _vertices(one, two, match.correspondence.astype(np.int64))
    samples, _ = symmetric_error(distances, truth, matched[:, 0], matched[:, 1])
    found, mirrored = pipeline.correspondences(one, two)
    pairs = [_vertices(one, two, each) for each in found]
    ends = extend(here.bases[first], there.bases[second], pairs, mirrored)
    everywhere = np.arange(truth.shape[1])
    vertices, symmetry = symmetric_error(distances, truth, everywhere, ends)
    direct, _ = symmetric_error(distances, truth[:1], everywhere, ends)
    return PairErrors(first, second, match.cc, samples, vertices, symmetry, direct)


def _vertices(first: Embedding, second: Embedding, pairs: Ints) -> Ints:
    """The vertices of paired samples, shape (p, 2)."""
    return np.stack([first.vertices[pairs[:, 0]], second.vertices[pairs[:, 1]]], axis=1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Side:
    """The meshes of one side of the pairs, embedded."""

    embeddings: list[Embedding]
    bases: list[Basis]

    @classmethod
    def of(cls, body: Body, poses: int, pipeline: Pipeline) -> "_Side":
        return cls.of_meshes([body.posed(pose) for pose in range(poses)], pipeline)

    @classmethod
    def of_meshes(cls, meshes: list[Mesh], pipeline: Pipeline) -> "_Side":
        return cls([pipeline.embed(mesh) for mesh in meshes], [basis(mesh) for mesh in meshes])
