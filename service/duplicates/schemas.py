"""JSON and CSV models of groups of near-identical shapes."""

import csv
import io

from pydantic import BaseModel, Field

from core.ranking.likeness import Likeness
from service.duplicates.records import Decision
from service.search.local_difference import LocalDifference
from service.shapes.schemas import Shape

COLUMNS = (
    "group",
    "id",
    "name",
    "likeness",
    "scale",
    "cc",
    "residual",
    "difference",
    "compared_with",
    "decision",
)

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of text that spreadsheets evaluate as a formula."""


def without_formula(text: str) -> str:
    """Return a text with an apostrophe before it if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


class Duplicate(BaseModel):
    """A shape of a group. The first shape is the oldest; the fields describe a shape relative to it."""

    shape: Shape
    likeness: Likeness = Field(
        description="same: rotated, moved or remeshed; scaled, if asked for: of another size; mirrored: a "
        "mirror image. A mirror image that is also a rotation, as of a symmetric shape, is same or scaled. "
        "variant, if variants are asked for: differs locally. The other values do not occur here."
    )
    scale: float = Field(description="The size of the shape over that of the first.")
    cc: float = Field(description="cc of the pair by which the shape was found; 1 for the first.")
    residual: float = Field(description="Residual of the same pair after registration; 0 for the first.")
    difference: LocalDifference | None = Field(
        default=None,
        description="If likeness is variant: what the shape has that the shape `compared_with` has not. The "
        "coordinates are those of the older of the two.",
    )
    compared_with: str | None = Field(
        default=None,
        description="With difference: the id of the shape that it compares with, mostly the first.",
    )
    decision: Decision | None = Field(
        default=None, description="The decision on the shape and the first, if there is one."
    )


class DuplicatesAnswer(BaseModel):
    """Groups of two or more near-identical shapes, the group with the oldest shape first."""

    groups: list[list[Duplicate]]
    shapes: int = Field(description="The number of shapes searched.")
    compared: int = Field(description="The number of pairs compared to judge these shapes.")
    aligned: int = Field(description="The number of pairs registered to judge these shapes.")
    unjudged: int = Field(
        default=0,
        description="The number of shapes of the collection that are not judged yet. The groups are complete "
        "when it is 0; ask again until then.",
    )
    milliseconds: dict[str, float] = Field(description="The time of each stage.")

    def csv(self) -> str:
        """Return a header, and a row for each shape of a group, with groups numbered from 1 (RFC 4180).

        An apostrophe precedes a name that a spreadsheet would take for a formula.
        """
        table = io.StringIO()
        rows = csv.writer(table)
        rows.writerow(COLUMNS)
        for number, group in enumerate(self.groups, 1):
            for duplicate in group:
                shape, scale = duplicate.shape, f"{duplicate.scale:.6g}"
                name = without_formula(shape.name)
                text = "" if duplicate.difference is None else duplicate.difference.text
                cells = duplicate.likeness, scale, duplicate.cc, duplicate.residual
                rows.writerow(
                    [number, shape.id, name, *cells, text, duplicate.compared_with, duplicate.decision]
                )
        return table.getvalue()
