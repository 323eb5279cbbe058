"""JSON, CSV and workbooks of groups of near-identical shapes."""

import csv
import io
from collections.abc import Iterator

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
    "pair_cc",
    "pair_residual",
    "difference",
    "compared_with",
    "decision",
    "paths",
)

MOST_IN_CELL = 32_767
"""The length of the longest text in a cell of a workbook."""

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of text that spreadsheets evaluate as a formula."""


def without_formula(text: str) -> str:
    """Return a text with an apostrophe before it if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


class Duplicate(BaseModel):
    """A shape of a group. The first shape is the oldest; likeness and scale are relative to it."""

    shape: Shape
    likeness: Likeness = Field(
        description="same: rotated, moved or remeshed; scaled, if asked for: of another size; mirrored: a "
        "mirror image. A mirror image that is also a rotation, as of a symmetric shape, is same or scaled. "
        "variant, if variants are asked for: differs locally. The other values do not occur here."
    )
    scale: float = Field(description="The size of the shape over that of the first.")
    cc: float = Field(
        description="cc of the pair by which the shape was found, with the first or another shape of the "
        "collection; 1 for the first."
    )
    residual: float = Field(description="Residual of the same pair after registration; 0 for the first.")
    difference: LocalDifference | None = Field(
        default=None,
        description="If likeness is variant: what the shape has that the shape `compared_with` has not. "
        "Coordinates and lengths are those of the older of the two; coordinates are null where only those of "
        "a copy of one of the two are known.",
    )
    compared_with: str | None = Field(
        default=None,
        description="With difference: the id of the shape that it compares with, mostly the first.",
    )
    decision: Decision | None = Field(
        default=None, description="The decision on the shape and the first, if there is one."
    )
    paths: list[str] = Field(
        default_factory=list,
        description="The paths of its files in sources, at most 100; none for a key that may not see paths.",
    )


class DuplicatesAnswer(BaseModel):
    """Groups of two or more near-identical shapes, the group with the oldest shape first."""

    groups: list[list[Duplicate]] = Field(description="The first groups, by default all.")
    total: int = Field(description="The number of all groups.")
    shapes: int = Field(description="The number of shapes searched.")
    compared: int = Field(description="The number of pairs compared to judge these shapes.")
    aligned: int = Field(description="The number of pairs registered to judge these shapes.")
    unjudged: int = Field(
        default=0,
        description="The number of shapes of the collection that are not judged yet. The groups are complete "
        "when it is 0; ask again until then.",
    )
    milliseconds: dict[str, float] = Field(description="The time of each stage.")

    def rows(self) -> Iterator[tuple[*tuple[str | int | float | None, ...], str]]:
        """Yield `COLUMNS`, and the cells of each shape of a group, with groups numbered from 1."""
        yield COLUMNS
        for number, group in enumerate(self.groups, 1):
            for duplicate in group:
                text = "" if duplicate.difference is None else duplicate.difference.text
                numbers = float(f"{duplicate.scale:.6g}"), duplicate.cc, duplicate.residual
                paths = "\n".join(duplicate.paths)
                last = text, duplicate.compared_with, duplicate.decision, paths
                yield number, duplicate.shape.id, duplicate.shape.name, duplicate.likeness, *numbers, *last

    def csv(self) -> str:
        """Return the rows in the form of RFC 4180.

        An apostrophe precedes a name that a spreadsheet would take for a formula.
        """
        table = io.StringIO()
        csv.writer(table).writerows(
            [without_formula(cell) if isinstance(cell, str) else cell for cell in row] for row in self.rows()
        )
        return table.getvalue()

    def xlsx(self) -> bytes:
        """Return the rows as a workbook of Office Open XML, of which no cell is a formula or a link."""
        # Few services write a workbook, and each process would hold the library.
        import xlsxwriter  # noqa: PLC0415

        file = io.BytesIO()
        plain = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
        with xlsxwriter.Workbook(file, plain) as workbook:
            sheet = workbook.add_worksheet("duplicates")
            sheet.freeze_panes(1, 0)
            for number, row in enumerate(self.rows()):
                *cells, paths = row
                # The library leaves out a longer text; no path is cut.
                while len(paths) > MOST_IN_CELL:
                    paths = paths.rpartition("\n")[0]
                sheet.write_row(number, 0, [*cells, paths])
        return file.getvalue()
