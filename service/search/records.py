"""What is searched for, how, and what is found."""

from dataclasses import dataclass
from functools import cached_property

from core.arrays import Bytes
from core.embedding import Embedding, Match
from core.pipeline import Pipeline
from core.serialization import spin_images_from_bytes
from service.pipelines.active import ActivePipeline
from service.search.rank_by import RankBy
from service.shapes.records import ShapeFilter, ShapeRecord


@dataclass(frozen=True)
class Options:
    """How to search.

    `shortlist_from` candidates or more are cut to the `shortlist_length` nearest by signature; of these the
    `reranked` that a rough look finds most alike are looked at more closely, and of these as many as are
    wanted and `finalists` more are compared in full. `sizes` is the factor by which the roots of two areas
    may differ at most.
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


@dataclass(frozen=True)
class Query:
    """What is searched for: an embedding, what made it, and the numbers of the stored shapes that it is."""

    active_pipeline: ActivePipeline
    record: bytes
    itself: frozenset[int]

    @cached_property
    def spin_images(self) -> Bytes:
        """Of its surface; see `core.embedding`."""
        return spin_images_from_bytes(self.record)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two embeddings, their match, and the chance that they are of one class."""

    pipeline: Pipeline
    first: Embedding
    second: Embedding
    match: Match
    combined: float


@dataclass(frozen=True, eq=False)
class Found:
    """One shape of an answer; `part_distance` is of a query with a part."""

    shape: ShapeRecord
    cc: float
    ssd: float
    sim: float
    combined: float
    comparison: Comparison | None
    part_distance: float | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What a search found.

    `best_cc` is the highest of all that were compared, if any were; `boundary_ratio` is of the query's surface, and
    `embedding` its own, if asked for.
    """

    pipeline: Pipeline
    found: list[Found]
    best_cc: float | None
    compared: int
    stored: int
    boundary_ratio: float
    embedding: Embedding | None
