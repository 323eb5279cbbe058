"""Dense correspondences as JSON."""

from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, Field

if TYPE_CHECKING:
    from core.embedding import DenseCorrespondence

DIGITS = 4


class Difference(BaseModel):
    """How one shape differs from the other, a value for each of its vertices."""

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
        """The differences of one direction."""
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
        description="With dense: for each vertex of the first file, in [0, 1]: 1 where no distance is left "
        "in the spectral domain, or where the surfaces coincide after a motion; 0 without a partner.",
    )
    length_ratio: float | None = Field(
        default=None, description="With dense: a length on the second shape over the same on the first."
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


def dense_fields(ways: "tuple[DenseCorrespondence, DenseCorrespondence]") -> dict[str, Any]:
    """The fields of a correspondence, both ways."""
    there, back = ways
    return {
        "vertices": there.vertices.tolist(),
        "confidence": _rounded(there.confidence),
        "length_ratio": there.scale,
        "simplified": there.simplified,
        "first_difference": Difference.of(there),
        "second_difference": Difference.of(back),
    }


def _rounded(values: Any) -> list[float]:  # noqa: ANN401
    """Values with four decimals: more would double the length of the JSON."""
    rounded: list[float] = values.astype("float64").round(DIGITS).tolist()
    return rounded
