"""A query, its options and its answer."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from functools import cached_property

from core.arrays import Bytes
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import view_signature
from core.embedding import Embedding, Match
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.ranking.likeness import Likeness
from core.registration.rigid_copy import Difference
from core.serialization import embedding_from_bytes
from service.pipelines.active import ActivePipeline
from service.search.rank_by import RankBy
from service.shapes.records import ShapeFilter, ShapeRecord


@dataclass(frozen=True)
class Options:
    """Options of a search.

    `shortlist_from` candidates or more are cut to the `shortlist_length` nearest by signature and half as
    many by view signature. The `reranked` first of the coarse ranking are re-ranked, and the
    `top_k + finalists` first of these are scored in full.
    `sizes` is the largest factor between the roots of two areas.
    """

    top_k: int
    rank_by: RankBy
    exhaustive: bool
    filter: ShapeFilter
    exclude_self: bool
    min_cc: float
    sizes: float | None
    correspondences: bool
    embedding: bool
    shortlist_from: int
    shortlist_length: int
    reranked: int
    finalists: int

    def sized(self, area: float) -> ShapeFilter:
        """The filter, with the sizes that a query of some area asks for."""
        if self.sizes is None:
            return self.filter
        least, greatest = area / self.sizes**2, area * self.sizes**2
        if self.filter.area is not None:
            least, greatest = max(least, self.filter.area[0]), min(greatest, self.filter.area[1])
        return replace(self.filter, area=(least, greatest))


@dataclass(frozen=True)
class Query:
    """The embedding that is searched for.

    Attributes
    ----------
    active_pipeline : ActivePipeline
        The pipeline that made it.
    record : bytes
        The embedding as it is stored, and sent to workers.
    itself : frozenset of int
        The numbers of the stored shapes that are the query itself.
    mesh : callable or None
        Reads the mesh of the query; None for a query whose likeness to other shapes is not asked for.
    number : int or None
        The number of the embedding, if it is stored.
    """

    active_pipeline: ActivePipeline
    record: bytes
    itself: frozenset[int]
    mesh: Callable[[], Awaitable[Mesh]] | None = None
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
        """The spin images of its surface; see `core.embedding`."""
        return self.descriptors.arrays["spin_images"]


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

    `typical_probability` is the class probability at the typical density of shapes, which does not depend on
    other stored shapes as `combined` does. `spectral` is the distance of its log eigenvalues from those of
    the query; `size_ratio` is the root of the ratio of its area to the query's; `part_distance` is set if the
    query is a part.
    """

    shape: ShapeRecord
    cc: float
    ssd: float
    sim: float
    combined: float
    typical_probability: float
    spectral: float
    size_ratio: float
    comparison: Comparison | None
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

    `relations` are those of the found shapes to the query; `best_cc` is the highest CC of all compared
    shapes, if there are any; `boundary_ratio` is of the query's surface; `embedding` is the query's, if asked
    for; `unit_mistake` is set if only shapes of other units pass the filter.
    """

    pipeline: Pipeline
    found: list[SearchResult]
    relations: list[Relation]
    best_cc: float | None
    compared: int
    stored: int
    boundary_ratio: float
    embedding: Embedding | None
    unit_mistake: UnitMistake | None = None
