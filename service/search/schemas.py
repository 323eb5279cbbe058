"""Searches and comparisons as JSON."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from service.search.rank_by import RankBy
from service.shapes.fields import ListedTags, split_tags
from service.shapes.filters import Filters
from service.shapes.schemas import SHAPE, EmbeddingArrays, Shape, warnings_of

if TYPE_CHECKING:
    from service.search.records import Answer, Comparison, SearchResult

PIPELINE = "3f1c9a7be2d40586"
MILLISECONDS: dict[str, Any] = {
    "read": 21.3,
    "embed": 148.2,
    "shortlist": 1.1,
    "compare": 87.4,
    "results": 2.0,
    "total": 262.9,
}
RESULT: dict[str, Any] = {
    "rank": 1,
    "cc": 0.981,
    "ssd": 0.142,
    "sim": 0.874,
    "combined": 0.94,
    "shape": SHAPE,
}
COMBINED = (
    "The chance that the two shapes are of one class, in [0, 1], from cc, the Laplace-Beltrami spectra, "
    "terms of form, and what lies about points of the surfaces, of which one may be a part of the other; "
    "higher is more alike, and it means the same in every answer. Calibrated for the default "
    "pipeline, on collections where about one pair in 25 is of one class; where fewer are, it is too high."
)
PAIR: dict[str, Any] = {
    "first": {"sample": 0, "vertex": 17, "position": [0.1, 0.2, 0.3]},
    "second": {"sample": 4, "vertex": 231, "position": [0.0, 0.3, 0.2]},
    "distance": 0.012,
    "effective": True,
}

EXCLUDED = 500
SAME_SIZE = 1.1


def _split(value: object) -> object:
    """Ids written as one text, or as a list whose parts may hold commas."""
    parts = [value] if isinstance(value, str) else value
    if isinstance(parts, list) and all(isinstance(part, str) for part in parts):
        return split_tags(parts)
    return value


Excluded = Annotated[
    list[Annotated[str, Field(max_length=64)]], BeforeValidator(_split), Field(max_length=EXCLUDED)
]


class QueryOptions(Filters):
    """How to search. Each may be given in the address or in the body; in the body it counts."""

    top_k: int = Field(default=3, ge=1, le=100, description="How many results at most.")
    rank_by: RankBy = Field(
        default="cc",
        description="What to sort by: cc, sim and combined from the highest, ssd from the lowest. "
        "Of equals, the one of the least ssd comes first, then the one stored first.",
    )
    partial: bool = Field(
        default=False,
        description="The query is a part, cut or scanned: sort by part_distance, from the lowest. "
        "rank_by=combined heeds the same of what looks incomplete, and how well the whole shapes match.",
    )
    exhaustive: bool = Field(
        default=False, description="Compare with every stored shape, however many there are."
    )
    filter: ListedTags = Field(
        default=[],
        description="The older name of `tag`; where both are given, all tags of both are asked for.",
        examples=[["animal"]],
    )
    exclude: Excluded = Field(
        default=[],
        description=f"Leave out the shapes with these ids, {EXCLUDED} at most: repeated, or with commas.",
    )
    min_cc: float | None = Field(
        default=None, ge=-1, le=1, description="Give only results whose cc is at least this."
    )
    scale: Literal["ignore", "respect"] = Field(
        default="ignore",
        description="The scores know no size. respect: compare only with shapes of about the query's, if all "
        f"files have one unit: the roots of their areas differ by {100 * (SAME_SIZE - 1):.0f} % at most.",
    )
    exclude_self: bool | None = Field(
        default=None,
        description="Leave out the query itself: the stored shape, or every shape with the file's very "
        "bytes. Unless given: true for a stored shape, false for a file.",
    )
    correspondences: bool = Field(
        default=False, description="Give with each result the points of the two shapes that correspond."
    )
    embedding: bool = Field(
        default=False, description="Give the query's own embedding, as of a stored shape /embedding does."
    )


class Point(BaseModel):
    """One end of a correspondence."""

    sample: int = Field(description="Its row in the embedding.")
    vertex: int = Field(description="The file's vertex at, or nearest to, it.")
    position: list[float] = Field(description="In the file's own frame and units.")


class Pair(BaseModel):
    """Two points that correspond."""

    first: Point
    second: Point
    distance: float = Field(
        description="Between them in the spectral domain after the thin-plate spline that sim is read with: "
        "with the default pipeline a soft one, and the mean of both ways if the shapes have as many samples."
    )
    effective: bool = Field(
        description="Whether that distance is small enough for sim, which counts nearest partners both ways."
    )


class Result(BaseModel):
    """One of the shapes most like the query."""

    model_config = ConfigDict(json_schema_extra={"example": RESULT})

    rank: int = Field(description="1 for the most alike.")
    cc: float = Field(description="Correlation of matched spectral coordinates, in [-1, 1].")
    ssd: float = Field(description="Sum of squared differences of them, 0 or more; less is more alike.")
    sim: float = Field(description="Share of points with an effective partner, in [0, 1].")
    combined: float = Field(description=COMBINED)
    part_distance: float | None = Field(
        default=None,
        description="With partial: how unlike the surface about the query's points is to that about the "
        "nearest points of the shape, 0 or more; it tells by its order among shapes.",
    )
    shape: Shape
    correspondence: list[Pair] | None = Field(
        default=None, description="From the query (first) to the shape (second), if asked for."
    )


class QueryAnswer(BaseModel):
    """The stored shapes most like the query."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "results": [RESULT],
                "matched": True,
                "compared": 190,
                "stored": 190,
                "pipeline": PIPELINE,
                "milliseconds": MILLISECONDS,
            }
        }
    )

    results: list[Result]
    matched: bool = Field(
        description="Whether the highest cc reaches the pipeline's threshold; results are given either way."
    )
    compared: int = Field(description="How many stored shapes were compared with the query.")
    stored: int = Field(description="How many shapes are stored.")
    pipeline: str = Field(description="Fingerprint of the pipeline that made and compared the embeddings.")
    milliseconds: dict[str, float] = Field(description="How long each stage took, and all of it.")
    warnings: list[str] = Field(default=[], description="What to know of the query's surface.")
    embedding: EmbeddingArrays | None = Field(default=None, description="Of the query, if asked for.")

    @classmethod
    def of(cls, answer: "Answer", *, milliseconds: dict[str, float]) -> "QueryAnswer":
        """The JSON of an answer."""
        return cls(
            results=[_result(rank, found) for rank, found in enumerate(answer.found, start=1)],
            matched=answer.best_cc is not None
            and answer.best_cc >= answer.pipeline.parameters.ranking.match_threshold,
            compared=answer.compared,
            stored=answer.stored,
            pipeline=answer.pipeline.fingerprint,
            milliseconds=milliseconds,
            warnings=warnings_of(answer.boundary_ratio),
            embedding=None if answer.embedding is None else EmbeddingArrays.of(answer.embedding),
        )


class CompareRequest(BaseModel):
    """Two stored shapes to compare."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "example": {"first": SHAPE["id"], "second": "5d0c8d8e-8f43-45f5-bb5e-5c8a1f4d2f10"}
        },
    )

    first: str = Field(description="The id of a shape.", max_length=64)
    second: str = Field(description="The id of another, or of the same.", max_length=64)


class CompareAnswer(BaseModel):
    """How alike two shapes are, and which of their points correspond."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "cc": 0.981,
                "ssd": 0.142,
                "sim": 0.874,
                "combined": 0.94,
                "correspondence": [PAIR],
                "pipeline": PIPELINE,
                "milliseconds": {"read": 1.2, "compare": 4.1, "total": 5.6},
            }
        }
    )

    cc: float = Field(description="Correlation of matched spectral coordinates, in [-1, 1].")
    ssd: float = Field(description="Sum of squared differences of them, 0 or more.")
    sim: float = Field(description="Share of points with an effective partner, in [0, 1].")
    combined: float = Field(description=COMBINED)
    correspondence: list[Pair]
    pipeline: str = Field(description="Fingerprint of the pipeline that made and compared the embeddings.")
    milliseconds: dict[str, float] = Field(description="How long each stage took, and all of it.")

    @classmethod
    def of(cls, comparison: "Comparison", *, milliseconds: dict[str, float]) -> "CompareAnswer":
        """The JSON of a comparison."""
        match = comparison.match
        return cls(
            cc=match.cc,
            ssd=match.ssd,
            sim=match.sim,
            combined=comparison.combined,
            correspondence=pairs(comparison),
            pipeline=comparison.pipeline.fingerprint,
            milliseconds=milliseconds,
        )


def pairs(comparison: "Comparison") -> list[Pair]:
    """The correspondence, each point with where it is on its mesh."""
    match = comparison.match
    first, second = match.correspondence[:, 0], match.correspondence[:, 1]
    columns: list[list[Any]] = [
        first.tolist(),
        comparison.first.vertices[first].tolist(),
        comparison.first.positions[first].tolist(),
        second.tolist(),
        comparison.second.vertices[second].tolist(),
        comparison.second.positions[second].tolist(),
        match.distances.tolist(),
        match.effective.tolist(),
    ]
    return [
        Pair(
            first=Point(sample=a, vertex=a_vertex, position=a_position),
            second=Point(sample=b, vertex=b_vertex, position=b_position),
            distance=distance,
            effective=effective,
        )
        for a, a_vertex, a_position, b, b_vertex, b_position, distance, effective in zip(
            *columns, strict=True
        )
    ]


def _result(rank: int, found: "SearchResult") -> Result:
    return Result(
        rank=rank,
        cc=found.cc,
        ssd=found.ssd,
        sim=found.sim,
        combined=found.combined,
        part_distance=found.part_distance,
        shape=Shape.of(found.shape),
        correspondence=None if found.comparison is None else pairs(found.comparison),
    )
