"""The whole method: a mesh to its embedding, two embeddings to their match."""

from collections.abc import Sequence
from operator import attrgetter

import numpy as np
from cachetools import LRUCache
from scipy.sparse import csr_array

from core import sparse_embedding
from core.arrays import Floats, Int8s, Ints
from core.dense.dense_correspondence import correspond
from core.dense.records import DenseCorrespondence
from core.dense.working_surface import MOST_VERTICES, SIMPLIFIED, WorkingSurface, working_surface
from core.embedding import Embedding, Match, Scores
from core.errors import IncompatibleEmbeddingsError
from core.graph.sparse_graph import SparseGraph, sample_distances
from core.matching.match_records import embedding_key
from core.matching.matcher import Prepared, matcher_of
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.preparation import PreparedSurface
from core.numerics.guarding import check_finite, guarded
from core.parameters import DEFAULT, Parameters
from core.ranking.class_probability import combined_scores
from core.ranking.local_density import LocalDensities
from core.sampling.sampling import embedded_points

PREPARED_BYTES = 128 * 1024 * 1024
"""The most bytes of prepared shapes that a pipeline caches, unless another number is given."""


MAPS = 4
"""The most maps of samples that a dense correspondence begins from."""


def _orientations(first: Embedding, second: Embedding) -> tuple[Int8s, Int8s] | None:
    """The orientations of two embeddings, if both have one."""
    if not (first.orientation.size and second.orientation.size):
        return None
    return first.orientation, second.orientation


class Pipeline:
    """The method under one set of parameters.

    The same mesh gives the same bytes in every process; linear algebra runs on one thread for this reason.

    Parameters
    ----------
    parameters : Parameters, optional
        Frozen; `DEFAULT` unless given. `fingerprint` is a hash of them and of the method version.
    memory : int
        The most bytes of prepared shapes that are cached; the least recently used ones are evicted.
    """

    def __init__(self, parameters: Parameters = DEFAULT, *, memory: int = PREPARED_BYTES) -> None:
        self.parameters = parameters
        self.fingerprint = parameters.fingerprint
        self.matcher = matcher_of(parameters)
        self._prepared: LRUCache[bytes, Prepared] = LRUCache(memory, getsizeof=attrgetter("nbytes"))

    def normalise(self, mesh: Mesh) -> PreparedSurface:
        """The mesh that is sampled: see `core.mesh.preparation.prepared_surface`."""
        return sparse_embedding.normalised(mesh, self.parameters)

    def open_surface(self, mesh: Mesh) -> Mesh:
        """The mesh, clean, simplified and smoothed, in its normal frame, with its boundary loops open.

        Raises
        ------
        DegenerateMeshError
            The mesh has no area.
        """
        with guarded():
            return sparse_embedding.opened(clean(mesh), self.parameters)

    def sample(self, mesh: Mesh, graph: csr_array) -> tuple[Ints, int]:
        """The embedded vertices and the number of samples: see `core.sampling.sampling`."""
        return embedded_points(mesh, graph, self.parameters)

    def distances(self, graph: csr_array, points: Ints, samples: Ints, sparse: SparseGraph) -> Floats:
        """Distances from the points to the samples: see `core.graph.sparse_graph`."""
        return sample_distances(graph, points, samples, sparse, self.parameters.spectral.distances)

    def embed(self, mesh: Mesh) -> Embedding:
        """The sparse spectral embedding of a mesh (section 3 of the paper).

        Raises
        ------
        DegenerateMeshError
            The mesh has no area, or too few vertices for the dimensions.
        CannotBeEmbeddedError
            The method fails on the mesh, for example by a division by zero.
        """
        return sparse_embedding.embed(mesh, self.parameters)

    def prepared(self, embedding: Embedding) -> Prepared:
        """The embedding as the matcher reads it, its splines factored; cached."""
        key = embedding_key(embedding)
        ready = self._prepared.get(key)
        if ready is None:
            ready = self.matcher.prepare(embedding, key)
            if ready.nbytes <= self._prepared.maxsize:
                self._prepared[key] = ready
        return ready

    def _checked(self, embedding: Embedding) -> Prepared:
        """The embedding as the matcher reads it, if this pipeline made it."""
        if embedding.fingerprint != self.fingerprint:
            raise IncompatibleEmbeddingsError(
                f"embedding {embedding.fingerprint} under pipeline {self.fingerprint}"
            )
        return self.prepared(embedding)

    def score(self, query: Embedding, candidates: Sequence[Embedding]) -> Scores:
        """CC, SSD and sim of one shape with each of several: the means over their spectra.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        with guarded():
            prepared = self._checked(query)
            return self.matcher.score(prepared, (self._checked(candidate) for candidate in candidates))

    def match(self, first: Embedding, second: Embedding) -> Match:
        """Two shapes compared: the scores of `score`, and the correspondence.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        with guarded():
            orientations = _orientations(first, second)
            found = self.matcher.match(self._checked(first), self._checked(second), orientations)
            check_finite(found.cc, found.ssd, found.sim, found.distances)
        return Match(
            cc=found.cc,
            ssd=found.ssd,
            sim=found.sim,
            correspondence=found.pairs.astype(np.int32),
            distances=found.distances.astype(np.float32),
            effective=found.effective,
            mirrored=found.mirrored,
        )

    def correspondences(self, first: Embedding, second: Embedding) -> tuple[list[Ints], bool | None]:
        """Several correspondences of samples that fit about equally well, at most `MAPS`, best first.

        Returns
        -------
        list of int64, shape (p, 2)
            Pairs (sample of the first shape, sample of the second); a sample may be in several pairs.
        bool or None
            Whether they reverse orientation: see `core.embedding.Match`.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        orientations = _orientations(first, second)
        if orientations is None:
            return [self.match(first, second).correspondence.astype(np.int64)], None
        with guarded():
            prepared = self._checked(first), self._checked(second)
            return self.matcher.candidates(*prepared, orientations, MAPS)

    def correspond(
        self, first: Mesh, second: Mesh, embeddings: tuple[Embedding, Embedding] | None = None
    ) -> DenseCorrespondence:
        """The vertex of the second mesh that corresponds to each vertex of the first.

        Parameters are those of `correspond_both`.
        """
        return self.correspond_both(first, second, embeddings)[0]

    def correspond_both(
        self, first: Mesh, second: Mesh, embeddings: tuple[Embedding, Embedding] | None = None
    ) -> tuple[DenseCorrespondence, DenseCorrespondence]:
        """The dense correspondence from the first mesh to the second, and from the second to the first.

        Parameters
        ----------
        first, second : Mesh
            Above `core.dense.working_surface.MOST_VERTICES` vertices, the correspondence is computed on
            simplified copies.
        embeddings : two Embedding, optional
            Of the two meshes by this pipeline; they are computed unless given.

        Raises
        ------
        DegenerateMeshError
            A mesh has no area, or too few vertices for the dimensions.
        CannotBeEmbeddedError
            The method fails on a mesh.
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        one, other = embeddings or (self.embed(first), self.embed(second))
        pairs, mirrored = self.correspondences(one, other)
        with guarded():
            return correspond(self._working(first, one), self._working(second, other), pairs, mirrored)

    def _working(self, mesh: Mesh, embedding: Embedding) -> WorkingSurface:
        bounded = self.parameters.with_values(
            mesh={
                "decimate_above": MOST_VERTICES,
                "decimate_to": SIMPLIFIED,
                "decimate_pieces_above": 0,
                "refine_simplified": 0,
            }
        )
        prepared = sparse_embedding.normalised(mesh, bounded)
        return working_surface(mesh, prepared.surface, prepared.frame, embedding.positions.astype(np.float64))

    def combined_with(
        self,
        query: Embedding,
        others: Sequence[Embedding],
        scores: Scores,
        own: LocalDensities | None = None,
        densities: LocalDensities | None = None,
    ) -> Floats:
        """`combined` of one embedding with c others, shape (c,): see `core.ranking.class_probability`."""
        return combined_scores(query, others, scores, own, densities)
