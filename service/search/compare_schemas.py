"""Comparisons of two shapes as JSON, and dense correspondences."""

from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, Field

from service.search.schemas import PAIR, PIPELINE, Pair, PairScores
from service.search.transfer_schemas import TRANSFER, Landmarks, Transfer, TransferAnswer
from service.shapes.fields import Id
from service.shapes.schemas import SHAPE

if TYPE_CHECKING:
    from core.embedding import DenseCorrespondence

DIGITS = 4
"""Decimals of values at vertices: more would double the length of the JSON."""

DENSE = "Add the vertex of the second shape for each vertex of the first, and where the two shapes differ."


class Difference(BaseModel):
    """The differences of one shape from the other, a value for each of its vertices."""

    stretch: list[float] = Field(
        description="Length around the vertex on the other shape over length on this one, over its median: 1 "
        "where the surface is not stretched."
    )
    displacement: list[float] | None = Field(
        description="The distance of the vertex from its partner after the best motion and scaling, in units "
        "of this shape; where there is no partner, its distance from the other surface. null unless the two "
        "shapes are rigid copies in large part."
    )
    partnered: list[bool] = Field(description="Whether the other shape has a corresponding place.")

    @classmethod
    def of(cls, way: "DenseCorrespondence") -> Self:
        """Return the differences of one direction."""
        return cls(
            stretch=_rounded(way.stretch),
            displacement=None if way.displacement is None else way.displacement.tolist(),
            partnered=way.partnered.tolist(),
        )


class DenseFields(BaseModel):
    """The dense correspondence of two shapes; every field is null unless it is asked for."""

    vertices: list[int] | None = Field(
        default=None,
        description="With dense: for each vertex of the first file the corresponding vertex of the second, "
        "from 0.",
    )
    confidence: list[float] | None = Field(
        default=None,
        description="With dense: for each vertex of the first file the probability that its partner is "
        "within 0.05 root of the area of the true one; where the surfaces coincide after a motion, 0.5 to 1 "
        "by their distance; 0 without a partner.",
    )
    length_ratio: float | None = Field(
        default=None, description="With dense: a length on the second shape over the same on the first."
    )
    maps: int | None = Field(
        default=None,
        description="With dense, landmarks or transfer: how many different maps fit about equally well: "
        "more than 1 if the shape is symmetric, or the shapes are unlike.",
    )
    ambiguous: bool | None = Field(
        default=None,
        description="Whether there are several such maps, of which one is given: landmarks tell them apart.",
    )
    mirrored: bool | None = Field(
        default=None,
        description="With dense, landmarks or transfer: whether the correspondence reverses orientation, as "
        "that of a shape and its mirror image, since none that preserves it fits about as well. null if the "
        "faces of a shape are turned every way.",
    )
    simplified: bool | None = Field(
        default=None,
        description="With dense: whether a mesh is so large that the correspondence was computed on "
        "simplified meshes, and transferred to the vertices of the files.",
    )
    first_difference: Difference | None = Field(
        default=None, description="With dense: how the first shape differs from the second."
    )
    second_difference: Difference | None = Field(
        default=None, description="With dense: how the second shape differs from the first."
    )


def map_fields(way: "DenseCorrespondence") -> dict[str, Any]:
    """Return the fields of a correspondence that are no values at vertices."""
    return {"maps": way.maps, "ambiguous": way.maps > 1, "mirrored": way.mirrored}


def dense_fields(ways: "tuple[DenseCorrespondence, DenseCorrespondence]") -> dict[str, Any]:
    """Return the fields of a correspondence, both ways."""
    forward, backward = ways
    return {
        **map_fields(forward),
        "vertices": forward.vertices.tolist(),
        "confidence": _rounded(forward.confidence),
        "length_ratio": forward.scale,
        "simplified": forward.simplified,
        "first_difference": Difference.of(forward),
        "second_difference": Difference.of(backward),
    }


def _rounded(values: Any) -> list[float]:  # noqa: ANN401
    rounded: list[float] = values.astype("float64").round(DIGITS).tolist()
    return rounded


class CompareRequest(BaseModel):
    """Two stored shapes to compare."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "example": {"first": SHAPE["id"], "second": "5d0c8d8e-8f43-45f5-bb5e-5c8a1f4d2f10"}
        },
    )

    first: Id = Field(description="The id of a shape.")
    second: Id = Field(description="The id of another shape, or of the same one.")
    dense: bool | None = Field(default=None, description=DENSE)
    landmarks: Landmarks | None = None
    transfer: Transfer | None = Field(default=None, description=TRANSFER)


class CompareAnswer(PairScores, DenseFields):
    """The scores of two shapes, and their corresponding points."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "cc": 0.981,
                "ssd": 0.142,
                "sim": 0.874,
                "combined": 0.94,
                "likeness": "pose",
                "correspondence": [PAIR],
                "pipeline": PIPELINE,
                "milliseconds": {"read": 1.2, "compare": 4.1, "likeness": 0.1, "total": 5.7},
            }
        }
    )

    correspondence: list[Pair]
    transferred: TransferAnswer | None = Field(
        default=None, description="With landmarks or transfer: what has been transferred."
    )
    pipeline: str = Field(description="Fingerprint of the pipeline that made and compared the embeddings.")
    milliseconds: dict[str, float] = Field(description="The time of each stage, and the total.")
