"""The whole method: a mesh to its embedding, two embeddings to their match."""

from collections.abc import Iterable, Sequence
from operator import attrgetter

import numpy as np
from cachetools import LRUCache

from core import sparse_embedding
from core.arrays import Floats, Int8s, Ints
from core.dense.dense_correspondence import SurfaceMap, surface_map
from core.dense.functional_maps import FINE
from core.dense.transfer import check_on_surface
from core.dense.working_surface import MOST_VERTICES, SIMPLIFIED, WorkingSurface, working_surface
from core.embedding import DenseCorrespondence, Embedding, Match, Scores
from core.errors import IncompatibleEmbeddingsError
from core.matching.match_records import embedding_key
from core.matching.matcher import Prepared, matcher_of
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.numerics.guarding import check_finite, guarded
from core.parameters import DEFAULT, Parameters
from core.ranking.class_probability import combined_scores
from core.ranking.local_density import LocalDensities
from core.registration.similarity import Similarity

PREPARED_BYTES = 128 * 1024 * 1024
"""The most bytes of prepared shapes that a pipeline caches, unless another number is given."""


MAPS = 4
"""The most maps of samples of one orientation that a dense correspondence begins from; half as many are added
that only the symmetries of the second shape show."""


def _orientations(first: Embedding, second: Embedding) -> tuple[Int8s, Int8s] | None:
    """Return the orientations of two embeddings, if both have one."""
    if not (first.orientation.size and second.orientation.size):
        return None
    return first.orientation, second.orientation


class Pipeline:
    """The method under one set of parameters.

    The same mesh gives the same bytes in every process; linear algebra runs on one thread for this reason.
    The `parameters` are frozen; `fingerprint` is a hash of them and of the method version. The cache has at
    most `memory` bytes of prepared shapes; the least recently used ones are evicted.
    """

    def __init__(self, parameters: Parameters = DEFAULT, *, memory: int = PREPARED_BYTES) -> None:
        self.parameters = parameters
        self.fingerprint = parameters.fingerprint
        self.matcher = matcher_of(parameters)
        self._prepared: LRUCache[bytes, Prepared] = LRUCache(memory, getsizeof=attrgetter("nbytes"))

    def open_surface(self, mesh: Mesh) -> Mesh:
        """Return a mesh clean, simplified and smoothed, in its normal frame, with its boundary loops open.

        Raise DegenerateMeshError if it has no area.
        """
        with guarded():
            return sparse_embedding.opened(clean(mesh), self.parameters)

    def embed(self, mesh: Mesh, descriptors: Iterable[str] | None = None) -> Embedding:
        """Compute the sparse spectral embedding of a mesh (section 3 of the paper).

        It holds the descriptors of these names, by default all that this installation computes. Raise
        DegenerateMeshError if the mesh has no area, or too few vertices for the dimensions, and
        CannotBeEmbeddedError if the method fails on the mesh, for example by a division by zero.
        """
        return sparse_embedding.embed(mesh, self.parameters, descriptors)

    def prepared(self, embedding: Embedding) -> Prepared:
        """Return an embedding as the matcher reads it, its splines factored; the result is cached."""
        key = embedding_key(embedding)
        prepared = self._prepared.get(key)
        if prepared is None:
            prepared = self.matcher.prepare(embedding, key)
            if prepared.nbytes <= self._prepared.maxsize:
                self._prepared[key] = prepared
        return prepared

    def _checked(self, embedding: Embedding) -> Prepared:
        """Return an embedding as the matcher reads it, if this pipeline made it."""
        if embedding.fingerprint != self.fingerprint:
            raise IncompatibleEmbeddingsError(
                f"embedding {embedding.fingerprint} under pipeline {self.fingerprint}"
            )
        return self.prepared(embedding)

    def score(self, query: Embedding, candidates: Sequence[Embedding]) -> Scores:
        """Compute CC, SSD and sim of one shape with each of c others: the means over their spectra.

        Raise IncompatibleEmbeddingsError if an embedding was made with other parameters, as all methods do.
        """
        with guarded():
            prepared = self._checked(query)
            return self.matcher.score(prepared, (self._checked(candidate) for candidate in candidates))

    def match(self, first: Embedding, second: Embedding) -> Match:
        """Compute the scores and the correspondence of two shapes; errors are those of `score`."""
        with guarded():
            orientations = _orientations(first, second)
            match = self.matcher.match(self._checked(first), self._checked(second), orientations)
            check_finite(match.cc, match.ssd, match.sim, match.distances)
        return match

    def correspondences(self, first: Embedding, second: Embedding) -> tuple[list[Ints], list[bool] | None]:
        """Compute correspondences of samples that fit about equally well, of each orientation best first.

        Each has pairs (sample of the first shape, sample of the second), shape (p, 2); a sample may be in
        several. At most one and a half `MAPS` preserve orientation. The second list tells which reverse it;
        it is None if an embedding has no orientation.
        """
        orientations = _orientations(first, second)
        if orientations is None:
            return [self.match(first, second).correspondence.astype(np.int64)], None
        with guarded():
            prepared = self._checked(first), self._checked(second)
            return self.matcher.candidates(*prepared, orientations, MAPS)

    def correspond(self, first: Mesh, second: Mesh) -> DenseCorrespondence:
        """Compute the vertex of the second mesh that corresponds to each vertex of the first.

        Parameters and errors are those of `correspond_both`.
        """
        return self.correspond_both(first, second)[0]

    def correspond_both(
        self,
        first: Mesh,
        second: Mesh,
        embeddings: tuple[Embedding, Embedding] | None = None,
        transform: Similarity | None = None,
    ) -> tuple[DenseCorrespondence, DenseCorrespondence]:
        """Compute the dense correspondence from the first mesh to the second, and back.

        Parameters and errors are those of `surface_map`.
        """
        return self.surface_map(first, second, embeddings, transform).correspondences()

    def surface_map(
        self,
        first: Mesh,
        second: Mesh,
        embeddings: tuple[Embedding, Embedding] | None = None,
        transform: Similarity | None = None,
        *,
        functions: int = FINE,
        landmarks: tuple[Floats, Floats] | None = None,
    ) -> SurfaceMap:
        """Compute the correspondence of two meshes, by which points, curves and values are transferred.

        Parameters
        ----------
        first, second : Mesh
            Above `core.dense.dense_correspondence.MOST_VERTICES` vertices, the correspondence is computed on
            simplified copies.
        embeddings : two Embedding, optional
            Of the two meshes by this pipeline; they are computed unless given.
        transform : Similarity, optional
            Of the first mesh onto the second, if they are registered as a copy or a variant.
        functions : int
            Eigenfunctions of the functional map: `FINE`, or `core.dense.functional_maps.FUNCTIONS` in a third
            of the time.
        landmarks : two float64, shape (l, 3), or None
            Points of both meshes that correspond.

        Raises
        ------
        OffSurfaceError
            A landmark is far from its mesh.
        DegenerateMeshError
            A mesh has no area, or too few vertices for the dimensions.
        CannotBeEmbeddedError
            The method fails on a mesh.
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        embeddings = embeddings or (self.embed(first, ()), self.embed(second, ()))
        pairs, mirrored = self.correspondences(*embeddings)
        with guarded():
            surfaces = (
                self._working_surface(first, embeddings[0]),
                self._working_surface(second, embeddings[1]),
            )
            if landmarks is not None:
                for surface, points, which in zip(surfaces, landmarks, ("first", "second"), strict=True):
                    check_on_surface(surface, points, "landmark", which)
            return surface_map(surfaces, pairs, mirrored, transform, functions, landmarks)

    def _working_surface(self, mesh: Mesh, embedding: Embedding) -> WorkingSurface:
        """Return the surface of a mesh on which a dense correspondence is computed."""
        bounded = self.parameters.with_values(
            mesh={
                "decimate_above": MOST_VERTICES,
                "decimate_to": SIMPLIFIED,
                "decimate_pieces_above": 0,
                "refine_simplified": 0,
            }
        )
        prepared = sparse_embedding.prepared(mesh, bounded)
        return working_surface(mesh, prepared.surface, prepared.frame, embedding.positions.astype(np.float64))

    def combined(
        self,
        query: Embedding,
        others: Sequence[Embedding],
        scores: Scores,
        own: LocalDensities | None = None,
        densities: LocalDensities | None = None,
    ) -> Floats:
        """Compute the probability that one shape and each of c others are of one class, shape (c,).

        Parameters are those of `core.ranking.class_probability.combined_scores`.
        """
        return combined_scores(query, others, scores, own, densities)
