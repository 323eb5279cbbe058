"""Searches as JSON: their options, declared once for the service, the clients and the command line; answers.

Scores and likenesses in words are here too: the page, the command line and the report show them.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from core.ranking.likeness import NEAR_ISOMETRIC, POSE_CC, SAME_SIZE, SIMILAR, Likeness, size_is_told
from service.collection import CollectionRecord
from service.http.problem_document import Cause
from service.search.local_difference import LocalDifference
from service.search.part_instances import PartInstances
from service.shapes.fields import Id, listed
from service.shapes.records import ShapeFilter
from service.shapes.schemas import SHAPE, EmbeddingArrays, Filters, MeasuredMesh, Shape

if TYPE_CHECKING:
    from core.embedding import Embedding, Match

RankBy = Literal["cc", "ssd", "sim", "combined", "contextual"]
"""The orders of results."""

LEAST_DIGITS, MOST_DIGITS = 4, 7
"""Decimals of a score. The samples' coordinates have the precision of seven."""

CC_OF_PAIRS = (
    "Unlike shapes have a high cc too: 0.83 to 0.96 for 90 % of the pairs of two classes of SHREC'11, and "
    "0.968 to 0.999 for 90 % of the pairs of one class."
)
"""How to read CC, as `isoshape evaluate` measured it (docs/likeness.md)."""

LIKENESS_WORDS: dict[Likeness, str] = {
    "same": "Same part",
    "scaled": "Same part",
    "mirrored": "Mirror image",
    "variant": "Variant",
    "part_of": "Part of",
    "pose": "Another pose",
    "similar": "Similar",
    "weak": "Weak",
}

PIPELINE = "3f1c9a7be2d40586"
MILLISECONDS: dict[str, Any] = {
    "read": 21.3,
    "embed": 148.2,
    "shortlist": 1.1,
    "compare": 87.4,
    "results": 2.0,
    "likeness": 0.1,
    "total": 263.0,
}
RESULT: dict[str, Any] = {
    "rank": 1,
    "cc": 0.981,
    "ssd": 0.142,
    "sim": 0.874,
    "combined": 0.94,
    "likeness": "pose",
    "size_ratio": 1.02,
    "shape": SHAPE,
}
PAIR: dict[str, Any] = {
    "first": {"sample": 0, "vertex": 17, "position": [0.1, 0.2, 0.3]},
    "second": {"sample": 4, "vertex": 231, "position": [0.0, 0.3, 0.2]},
    "distance": 0.012,
    "effective": True,
}

EXCLUDED = 500
MOST_MAPPED = 2_000
SIZE_TOLERANCE = 0.1
LARGEST_SIZE_TOLERANCE = 10.0


def score_in_words(score: float) -> str:
    """Return a score of at most 1 with the decimals that show two digits of its distance from 1.

    0.9712 has four decimals, 0.999987 six; 1 within half of the last decimal is 1.0000.
    """
    apart = abs(1.0 - score)
    if apart < 0.5 * 10.0**-MOST_DIGITS:
        return f"{1.0:.{LEAST_DIGITS}f}"
    digits = math.ceil(-math.log10(apart)) + 1
    return f"{score:.{min(max(digits, LEAST_DIGITS), MOST_DIGITS)}f}"


def likeness_in_words(
    likeness: Likeness,
    scale: float | None,
    difference: LocalDifference | None = None,
    instances: PartInstances | None = None,
) -> str:
    """Return a likeness in words: "Same part, 1.5 times as large".

    Parameters
    ----------
    likeness : Likeness
    scale : float or None
        Length in the second shape over length in the first; it is told where the sizes differ.
    difference : LocalDifference or None
        What it says follows.
    instances : PartInstances or None
        What it says is told instead.
    """
    if instances is not None:
        return instances.text
    words = LIKENESS_WORDS[likeness]
    if scale is not None and size_is_told(scale):
        # Four digits; the second format writes 10000 without an exponent.
        words += f", {float(f'{scale:.4g}'):g} times as large"
    return words if difference is None else f"{words}: {difference.text}"


Excluded = Annotated[list[Id], BeforeValidator(listed), Field(max_length=EXCLUDED)]


class SearchOptions(Filters):
    """Options of a search. An option in the body overrides the query parameter."""

    top_k: int = Field(default=3, ge=1, le=100, description="The largest number of results.")
    rank_by: RankBy | None = Field(
        default=None,
        description="The score that sorts the results: cc, sim and combined from the highest, ssd from the "
        "lowest. contextual, an order without a score, also reads which stored shapes are near each other: "
        "a shape comes earlier if others like the query are like it; while the service does not know enough "
        "of that, the order is that of combined, and `warnings` tell so. Results with equal scores are "
        "ordered by ssd, then the older shape comes first; by combined or contextual, copies with combined "
        "above 0.99 come first, and then variants. The default is cc, unless the service is set to another "
        "(`rank_by` of GET /version).",
    )
    partial: bool = Field(
        default=False,
        description="The query is a part of a surface, cut or scanned: the results are sorted by "
        "part_distance, from the lowest. rank_by=combined uses the same distance for a surface that looks "
        "incomplete, together with the match of the whole shapes.",
    )
    exhaustive: bool = Field(
        default=False, description="Compare the query with every stored shape, and skip the shortlist."
    )
    exclude: Excluded = Field(
        default=[],
        description=f"Leave out the shapes with these ids, at most {EXCLUDED}: repeated, or separated "
        "by commas.",
    )
    min_cc: float | None = Field(default=None, ge=-1, le=1, description="Leave out results with a lower cc.")
    scale: Literal["ignore", "respect"] = Field(
        default="ignore",
        description="The scores do not depend on size. respect: compare only with shapes of about the "
        "query's size, for files that share one unit: the square roots of the areas differ by at most "
        "`size_tolerance`. If there is none, `warnings` tells of shapes that are 10, 25.4 or 1,000 times as "
        "large or as small.",
    )
    size_tolerance: float = Field(
        default=SIZE_TOLERANCE,
        gt=0,
        le=LARGEST_SIZE_TOLERANCE,
        description="With scale=respect: the largest relative difference of two sizes, 0.1 for 10 %.",
    )
    exclude_self: bool | None = Field(
        default=None,
        description="Leave out the query itself: the stored shape, or every shape with exactly the bytes of "
        "the file. The default is true for a stored shape and false for a file.",
    )
    correspondences: bool = Field(
        default=False, description="Add to each result the corresponding points of the two shapes."
    )
    embedding: bool = Field(
        default=False,
        description="Add the embedding of the query, as GET /shapes/{shape_id}/embedding gives it.",
    )

    def filtered(self, collection: CollectionRecord) -> ShapeFilter:
        """Return the filter of the shapes of a collection, without the excluded ones.

        Raises
        ------
        BadRequestFieldsError
            A condition on metadata is not written key=value.
        """
        return replace(super().filtered(collection), excluded=tuple(self.exclude))


class Point(BaseModel):
    """A point of one of two corresponding shapes."""

    sample: int = Field(description="The row of the point in the embedding.")
    vertex: int = Field(description="The vertex of the file at the point, or nearest to it.")
    position: list[float] = Field(
        description="Coordinates in the frame of the file and the unit of the shape."
    )


class Pair(BaseModel):
    """Two corresponding points."""

    first: Point
    second: Point
    distance: float = Field(
        description="The distance of the two points in the spectral domain after the thin-plate spline of "
        "sim. In the default pipeline the spline is regularised, and the distance is the mean over both "
        "directions if the shapes have equally many samples."
    )
    effective: bool = Field(
        description="Whether the distance is small enough to count for sim, which counts nearest neighbours "
        "in both directions."
    )


class PairScores(BaseModel):
    """The scores and the likeness of two shapes. The first shape of a search is the query."""

    cc: float = Field(
        description="Correlation coefficient of the matched spectral coordinates, in [-1, 1]; 1 for the same "
        f"shape, also in another pose. {CC_OF_PAIRS}"
    )
    ssd: float = Field(
        description="Root of the sum of squared differences of the same coordinates, divided by the number "
        "of pairs: 0 or more; lower is more similar."
    )
    sim: float = Field(description="Share of the points with an effective correspondence, in [0, 1].")
    combined: float = Field(
        description="The probability that the two shapes belong to one class, in [0, 1], from cc, the "
        "Laplace-Beltrami spectra, global descriptors, spin images, by which one surface may be a part of "
        "the other, views, the reliability of both meshes and the local densities of the collection. Higher "
        "is more similar. The value of a pair depends on the other stored shapes: it is comparable within a "
        "collection. Calibrated for the default pipeline, on collections with about one pair in 32 of one "
        "class; with fewer such pairs it is too high."
    )
    likeness: Likeness = Field(
        description="The property in which the shapes are alike. same: a rigid copy of one size "
        f"(to {100 * SAME_SIZE:.0f} %), on any mesh: the surfaces differ nowhere by more than the errors of "
        "both meshes; scaled: a rigid copy of another size; mirrored: a rigid copy of the mirror image, of "
        "any size; variant: a rigid copy of any size but for a local difference. Registration, of the "
        "samples or else of the surfaces, confirms these. part_of: one of the two has several pieces, of "
        "which some are rigid copies of the other in its size. pose: nearly isometric, as two poses of one "
        f"body (the isometry distance, of log eigenvalues and volumes, is at most {NEAR_ISOMETRIC}, and cc "
        f"at least {POSE_CC}) and bent: no similarity transform brings corresponding points near each other. "
        f"similar: combined is at least {SIMILAR}. weak: none of these."
    )
    scale: float | None = Field(
        default=None,
        description="The size of the second shape over that of the first, if likeness is same, scaled, "
        "mirrored or variant.",
    )
    transform: list[list[float]] | None = Field(
        default=None,
        description="With scale: the matrix, 4 rows of 4, that maps the second shape onto the first, in "
        "homogeneous coordinates of their files. Its determinant is negative for a reflection.",
    )
    difference: LocalDifference | None = Field(
        default=None,
        description="If likeness is variant: where the two differ, in the coordinates of the first shape.",
    )
    instances: PartInstances | None = Field(
        default=None, description="If likeness is part_of: which shape has the other, and how many times."
    )


class Result(PairScores):
    """One of the shapes most similar to the query."""

    model_config = ConfigDict(json_schema_extra={"example": RESULT})

    rank: int = Field(description="1 for the most similar shape.")
    part_distance: float | None = Field(
        default=None,
        description="With partial: the distance of the query's spin images from the nearest spin images of "
        "the shape, 0 or more. Only its order among shapes has a meaning.",
    )
    size_ratio: float | None = Field(
        default=None,
        description="The size of the shape over that of the query: `scale` if the shape is a rigid copy, and "
        "otherwise the square root of the ratio of the areas.",
    )
    shape: Shape
    correspondence: list[Pair] | None = Field(
        default=None,
        description="From the query (first) to the shape (second), with the option correspondences.",
    )


class QueryAnswer(BaseModel):
    """The stored shapes most similar to the query."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "query": {"facts": SHAPE["facts"], "unit": ""},
                "results": [RESULT],
                "matched": True,
                "ranked_by": "cc",
                "compared": 190,
                "stored": 190,
                "pipeline": PIPELINE,
                "milliseconds": MILLISECONDS,
            }
        }
    )

    query: MeasuredMesh
    results: list[Result]
    parts: list[Result] = Field(
        default=[],
        description="Further shapes, at most `top_k`, whose likeness is part_of: plates and assemblies that "
        "have the query as a piece, or shapes that are pieces of the query. Those with more instances come "
        "first, then the older ones; ranks go on from those of the results.",
    )
    matched: bool = Field(
        description="Whether one of the results and parts is alike: its likeness is not weak."
    )
    ranked_by: Literal["cc", "ssd", "sim", "combined", "contextual", "part_distance"] = Field(
        description="The score, or the order, that sorts the results."
    )
    compared: int = Field(description="The number of shapes that the query was compared with.")
    stored: int = Field(description="The number of shapes of the collection.")
    pipeline: str = Field(description="Fingerprint of the pipeline that made and compared the embeddings.")
    milliseconds: dict[str, float] = Field(description="The time of each stage, and the total.")
    warnings: list[str] = Field(
        default=[],
        description="Warnings about the surface of the query; about shapes of another unit, if none passes "
        "the filter by size; about another order whose first result has a better likeness; and about a "
        "contextual order that is not known yet.",
    )
    embedding: EmbeddingArrays | None = Field(
        default=None, description="The embedding of the query, with the option embedding."
    )

    @property
    def found(self) -> list[Result]:
        """The results, then the parts."""
        return [*self.results, *self.parts]


class BatchAnswer(BaseModel):
    """The answers to the queries of a batch, in the order of the files or the ids."""

    answers: list[QueryAnswer | Cause] = Field(description="A file that cannot be used has its problem.")


class Family(BaseModel):
    """Shapes that are like each other."""

    shapes: list[Shape] = Field(description="At least two, the oldest first.")


class FamiliesAnswer(BaseModel):
    """Families of the stored shapes that pass the filter."""

    families: list[Family] = Field(description="The family of the oldest shape first.")
    single: int = Field(description="The number of shapes that pass the filter and are in no family.")
    unknown: int = Field(
        description="The number of shapes of the collection whose neighbours are not known yet. They are "
        "found in the background."
    )


class MapShape(BaseModel):
    """A shape of a map."""

    id: str
    name: str
    x: float = Field(description="Position from left to right, in [0, 1].")
    y: float = Field(description="Position from top to bottom, in [0, 1].")
    column: int = Field(description="Column of the shape's cell, from 0.")
    row: int = Field(description="Row of the shape's cell, from 0.")


class MapAnswer(BaseModel):
    """Shapes on a plane; similar shapes are near each other."""

    shapes: list[MapShape] = Field(description="The oldest first; no two have one cell.")
    size: int = Field(description="The number of columns, and of rows.")
    total: int = Field(
        description="The number of shapes that pass the filter. The map has at most "
        f"{MOST_MAPPED:,} of them, chosen evenly by age."
    )
    version: str = Field(description="Names the pictures of GET /map/thumbnails.png, and their order.")


def pairs(match: "Match", first: "Embedding", second: "Embedding") -> list[Pair]:
    """Return the correspondence of two embeddings, each point with its position on its mesh."""
    ends = [
        [
            Point(sample=sample, vertex=vertex, position=position)
            for sample, vertex, position in zip(
                samples.tolist(),
                embedding.vertices[samples].tolist(),
                embedding.positions[samples].tolist(),
                strict=True,
            )
        ]
        for embedding, samples in zip((first, second), match.correspondence.T, strict=True)
    ]
    measures = match.distances.tolist(), match.effective.tolist()
    return [
        Pair(first=a, second=b, distance=distance, effective=effective)
        for a, b, distance, effective in zip(*ends, *measures, strict=True)
    ]
