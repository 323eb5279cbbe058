"""Groups of near-identical shapes as JSON and as CSV."""

import csv
import io
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, Field

from service.shapes.records import ShapeRecord
from service.shapes.schemas import Shape

if TYPE_CHECKING:
    from service.duplicates.groups import Member
    from service.duplicates.service import Duplicates

COLUMNS = ("group", "id", "name", "kinship", "scale", "cc", "residual")

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for a formula begins so."""


class Duplicate(BaseModel):
    """A shape of a group. The first is the oldest, and the others are told by what they are to it."""

    shape: Shape
    kinship: Literal["same", "scaled", "mirrored"] = Field(
        description="same: turned, moved or meshed anew; scaled: of another size; mirrored: in any size. A "
        "mirror image that a rotation gives as well, as of a symmetric shape, is same or scaled."
    )
    scale: float = Field(description="Its lengths over those of the first.")
    cc: float = Field(description="Of the pair that it was found by; 1 for the first.")
    residual: float = Field(description="Of the same pair; 0 for the first.")

    @classmethod
    def of(cls, member: "Member", record: ShapeRecord) -> "Duplicate":
        """The JSON of a member."""
        return cls(
            shape=Shape.of(record),
            kinship=member.kinship,
            scale=member.scale,
            cc=member.cc,
            residual=member.residual,
        )


class DuplicatesAnswer(BaseModel):
    """The groups of near-identical shapes, each of two or more, the oldest first."""

    groups: list[list[Duplicate]]
    shapes: int = Field(description="How many shapes were looked at.")
    compared: int = Field(description="How many pairs were near enough by signature to be compared.")
    aligned: int = Field(description="How many of these were laid onto each other.")
    milliseconds: dict[str, float] = Field(description="Wall time by stage.")

    @classmethod
    def of(cls, found: "Duplicates", *, milliseconds: dict[str, float]) -> "DuplicatesAnswer":
        """The JSON of what was found."""
        return cls(
            groups=[[Duplicate.of(member, record) for member, record in group] for group in found.groups],
            shapes=found.shapes,
            compared=found.compared,
            aligned=found.aligned,
            milliseconds=milliseconds,
        )

    def csv(self) -> str:
        """A row for each shape of a group, groups numbered from 1, under a row of names (RFC 4180).

        A name that a spreadsheet would take for a formula has an apostrophe before it.
        """
        text = io.StringIO()
        rows = csv.writer(text)
        rows.writerow(COLUMNS)
        for number, group in enumerate(self.groups, 1):
            for one in group:
                shape = one.shape
                name = f"'{shape.name}" if shape.name.startswith(FORMULA) else shape.name
                rows.writerow([number, shape.id, name, one.kinship, f"{one.scale:.6g}", one.cc, one.residual])
        return text.getvalue()
