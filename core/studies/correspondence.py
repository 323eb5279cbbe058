"""How right correspondences are: poses of one body, whose vertices are known to correspond."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.embedding import Embedding
from core.gallery.bodies import Body, make_body
from core.graph.edge_graph import edge_graph
from core.matching.dense_correspondence import Basis, basis, extend
from core.mesh.cleaning import face_areas
from core.parameters import Parameters
from core.pipeline import Pipeline

MOST_ERROR = 0.06
"""What the mean geodesic error of a class may be, over the square root of the area."""


@dataclass(frozen=True)
class PairErrors:
    """One pose matched with another.

    Attributes
    ----------
    first, second : int
        The poses; each vertex of the first is given one of the second.
    cc : float
        Of the two.
    samples, vertices : float
        Mean geodesic error of the matched samples, and of the correspondence extended to all vertices, over
        the square root of the area; each the least over the body's symmetries.
    symmetry : int
        Which symmetry the extended correspondence follows: a row of `Body.partners`.
    """

    first: int
    second: int
    cc: float
    samples: float
    vertices: float
    symmetry: int


@dataclass(frozen=True)
class BodyErrors:
    """All ordered pairs of a body's poses."""

    label: str
    body: int
    pairs: tuple[PairErrors, ...]

    @property
    def samples(self) -> float:
        """Mean over the pairs."""
        return float(np.mean([pair.samples for pair in self.pairs]))

    @property
    def vertices(self) -> float:
        """Mean over the pairs."""
        return float(np.mean([pair.vertices for pair in self.pairs]))


REMESHED = 2100
"""Vertices of the second mesh; any number but `core.gallery.bodies.VERTICES`."""


def surface_distances(body: Body) -> Floats:
    """Geodesic distances between all vertices of a body at rest, over the square root of its area, (n, n).

    Poses bend joints and stretch little: the distances at rest are those of every pose to a few per cent.
    """
    area = float(face_areas(body.rest.vertices, body.rest.faces).sum())
    found = np.asarray(dijkstra(edge_graph(body.rest)))
    return np.asarray(np.minimum(found, found.T) / np.sqrt(area))


def symmetric_error(distances: Floats, partners: Ints, vertices: Ints, found: Ints) -> tuple[float, int]:
    """Mean distance of found vertices from the true ones, and the symmetry under which it is least.

    Parameters
    ----------
    distances : float64, shape (m, m)
        Between the vertices of the other mesh.
    partners : int64, shape (g, n)
        As `Body.partners`.
    vertices, found : int64, shape (p,)
        Vertices of one pose, and what was found for each in another.
    """
    errors = distances[found, partners[:, vertices]].mean(axis=1)
    return float(errors.min()), int(errors.argmin())


def study_body(
    label: str, number: int, poses: int, parameters: Parameters, *, remeshed: bool = False
) -> BodyErrors:
    """Match every two poses of a body, and compare with the truth both ways round.

    Parameters
    ----------
    label : str
        A class of the gallery.
    number : int
        Which individual, >= 0.
    poses : int
        Poses 0 .. `poses` - 1, at least 2.
    parameters : Parameters
        Of the pipeline that matches.
    remeshed : bool
        Whether the second of each pair has another mesh, so that the same triangles are no help. The truth is
        then known to within half an edge.
    """
    body = make_body(label, number)
    other = make_body(label, number, vertices=REMESHED) if remeshed else body
    truth, distances = body.partners(other), surface_distances(other)
    pipeline = Pipeline(parameters)
    sides = [_Side.of(side, poses, pipeline) for side in ([body, other] if remeshed else [body])]
    here, there = sides[0], sides[-1]
    everywhere = np.arange(len(body.rest.vertices))
    errors: list[PairErrors] = []
    for first, second in permutations(range(poses), 2):
        one, two = here.embeddings[first], there.embeddings[second]
        match = pipeline.match(one, two)
        i, j = match.correspondence.T
        known = np.stack([one.vertices[i], two.vertices[j]], axis=1).astype(np.int64)
        samples, _ = symmetric_error(distances, truth, known[:, 0], known[:, 1])
        found = extend(here.bases[first], there.bases[second], known)
        vertices, symmetry = symmetric_error(distances, truth, everywhere, found)
        errors.append(PairErrors(first, second, match.cc, samples, vertices, symmetry))
    return BodyErrors(label, number, tuple(errors))


@dataclass(frozen=True, eq=False)
class _Side:
    """All poses of one mesh of a body, ready to be matched."""

    embeddings: list[Embedding]
    bases: list[Basis]

    @classmethod
    def of(cls, body: Body, poses: int, pipeline: Pipeline) -> "_Side":
        meshes = [body.posed(pose) for pose in range(poses)]
        return cls([pipeline.embed(mesh) for mesh in meshes], [basis(mesh) for mesh in meshes])
