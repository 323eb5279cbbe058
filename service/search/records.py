"""A query, its candidates, their scores, and the answer."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import view_signature
from core.embedding import Embedding, Match
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.ranking.likeness import Likeness
from core.ranking.local_density import LocalDensities
from core.registration.rigid_copy import Difference
from core.serialization import embedding_from_bytes
from service.index.density_samples import CollectionSample
from service.index.repository import IndexEntries
from service.pipelines.active import ActivePipeline
from service.shapes.records import ShapeRecord

ReadMesh = Callable[[], Awaitable[Mesh]]


@dataclass(frozen=True)
class Query:
    """The embedding that is searched for.

    Attributes
    ----------
    active_pipeline : ActivePipeline
        The pipeline that made it.
    record : bytes
        The embedding as it is stored, and sent to workers.
    excluded : frozenset of int
        The numbers of stored shapes that are left out: the query itself.
    mesh : callable or None
        Reads the mesh of the query; None for a query whose likeness to other shapes is not asked for.
    number : int or None
        The number of the embedding, if it is stored.
    """

    active_pipeline: ActivePipeline
    record: bytes
    excluded: frozenset[int]
    mesh: ReadMesh | None = None
    number: int | None = None

    @cached_property
    def embedding(self) -> Embedding:
        """The record, decoded once."""
        return embedding_from_bytes(self.record)

    @cached_property
    def descriptors(self) -> ShapeDescriptors:
        """The descriptors of its surface."""
        return descriptors_of(self.embedding)

    @cached_property
    def view_signature(self) -> Bytes:
        """The view signature, shape (v,)."""
        return view_signature(self.embedding.descriptors["views"])

    @property
    def spin_images(self) -> Bytes:
        """The spin images of its surface."""
        return self.descriptors.arrays["spin_images"]


@dataclass(frozen=True, eq=False)
class Candidates:
    """The shapes that a query is compared with.

    Attributes
    ----------
    entries : IndexEntries
        Their signatures and other short descriptors.
    shortlisted : bool
        Whether they are a shortlist, of which only the best are matched in full.
    stored : int
        Number of shapes in the collection.
    sample : CollectionSample or None
        The sample in which local densities are measured; typical densities are used without one.
    density : LocalDensities or None
        Of the query, in the sample.
    """

    entries: IndexEntries
    shortlisted: bool
    stored: int
    sample: CollectionSample | None = None
    density: LocalDensities | None = None

    def __len__(self) -> int:
        """Return the number of candidates."""
        return len(self.entries.shapes)

    def only(self, indices: NDArray[np.integer] | NDArray[np.bool_]) -> "Candidates":
        """Return the candidates at some indices, or those that a mask selects."""
        return replace(self, entries=self.entries.only(indices))


@dataclass(frozen=True, eq=False)
class MatchedCandidates:
    """Candidates and their scores with the query; each array has shape (c,).

    Attributes
    ----------
    candidates : Candidates
    cc, ssd, sim : float64
        See `core.matching`. Similar shapes have a small `ssd`, and large `cc` and `sim`.
    log_odds : float64 or None
        The log odds that the two shapes are of one class, if the answer is ranked by them.
    """

    candidates: Candidates
    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]
    log_odds: NDArray[np.float64] | None = None

    def only(self, indices: NDArray[np.integer] | NDArray[np.bool_]) -> "MatchedCandidates":
        """Return the candidates at some indices, or those that a mask selects, with their scores."""
        return MatchedCandidates(
            self.candidates.only(indices),
            self.cc[indices],
            self.ssd[indices],
            self.sim[indices],
            None if self.log_odds is None else self.log_odds[indices],
        )


@dataclass(frozen=True)
class Relation:
    """The likeness of a second shape to a first one.

    Attributes
    ----------
    likeness : Likeness
    scale : float or None
        Length in the second shape over length in the first, if the second is a rigid copy or a variant.
    difference : Difference or None
        Where a variant differs.
    """

    likeness: Likeness
    scale: float | None = None
    difference: Difference | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two embeddings, their match, and the probability that they are of one class.

    `combined` depends on how dense the stored shapes are; see `SearchResult`.
    """

    pipeline: Pipeline
    first: Embedding
    second: Embedding
    match: Match
    combined: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """One shape of an answer.

    Attributes
    ----------
    shape : ShapeRecord
    record : bytes or None
        Its embedding, if that was read: for correspondences, or since the shape may be a rigid copy.
    cc, ssd, sim : float
        Its scores with the query.
    combined : float
        The class probability at the density of the collection's shapes.
    typical_probability : float
        The class probability at the typical density, which does not depend on other stored shapes.
    spectral : float
        The distance of its log eigenvalues from those of the query.
    size_ratio : float
        The root of the ratio of its area to the query's.
    comparison : Comparison or None
        Its match with the query, if correspondences are asked for.
    part_distance : float or None
        Set if the query is a part.
    """

    shape: ShapeRecord
    record: bytes | None
    cc: float
    ssd: float
    sim: float
    combined: float
    typical_probability: float
    spectral: float
    size_ratio: float
    comparison: Comparison | None = None
    part_distance: float | None = None


@dataclass(frozen=True)
class UnitMistake:
    """Shapes that would pass the filter of a search if files had another unit.

    Attributes
    ----------
    factor : float
        The factor at which the most similar shape is, times the sizes that were asked for.
    count : int
        Number of shapes at that factor.
    nearest : SearchResult
        The most similar shape.
    """

    factor: float
    count: int
    nearest: SearchResult


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to a search.

    `relations` are those of the results to the query; `best_cc` is the highest CC of all matched shapes, if
    there are any; `boundary_ratio` is of the query's surface; `embedding` is the query's, if asked for;
    `unit_mistake` is set if only shapes of other units pass the filter.
    """

    pipeline: Pipeline
    results: list[SearchResult]
    relations: list[Relation]
    best_cc: float | None
    compared: int
    stored: int
    boundary_ratio: float
    embedding: Embedding | None
    unit_mistake: UnitMistake | None = None
