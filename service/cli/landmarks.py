"""Landmarks of two shapes as files of comma-separated values."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from service.console import fail
from service.duplicates.schemas import FORMULA
from service.search.transfer_schemas import TransferAnswer

NAME, FIRST, SECOND = "name", ("x", "y", "z"), ("x2", "y2", "z2")
"""Columns of a file: a point of the first shape and, where it is known, its partner on the second."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class LandmarkFile:
    """Points of the first shape by name, and the points of both that must correspond."""

    names: list[str]
    points: list[Point]
    pairs: list[tuple[Point, Point]]


def read_landmarks(path: Path) -> LandmarkFile:
    """Read a file with the columns name, x, y, z and perhaps x2, y2, z2; end the command if it is another."""
    found = LandmarkFile([], [], [])
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = csv.DictReader(stream, skipinitialspace=True, strict=True)
            missing = {NAME, *FIRST} - set(rows.fieldnames or ())
            if missing:
                needed = "it needs name, x, y and z, separated by commas"
                fail(f"{path} has no column {sorted(missing)[0]!r}; {needed}", status=2)
            for row in rows:
                point = _point(row, FIRST)
                found.names.append(row[NAME] or "")
                found.points.append(point)
                if any(row.get(column) for column in SECOND):
                    found.pairs.append((point, _point(row, SECOND)))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        fail(f"{path} cannot be read: {error}", status=2)
    except ValueError as error:
        fail(f"{path}, line {rows.line_num}: {error}", status=2)
    if not found.points:
        fail(f"{path} has no landmarks", status=2)
    return found


def _point(row: dict[str, str | None], columns: Sequence[str]) -> Point:
    x, y, z = (float(row.get(column) or "") for column in columns)
    return x, y, z


def transferred_csv(names: Sequence[str], answer: TransferAnswer) -> str:
    """Return a header, and a row for each landmark: its place on the second shape, and the confidence.

    An apostrophe precedes a name that a spreadsheet would take for a formula.
    """
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow([NAME, *FIRST, "confidence"])
    for name, point in zip(names, answer.points, strict=True):
        rows.writerow([f"'{name}" if name.startswith(FORMULA) else name, *point.position, point.confidence])
    return table.getvalue()
