"""A CSV file of metadata: a row for each mesh, a column `tags`, and metadata in all other columns."""

import csv
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from service.datasets import DatasetError
from service.http.problem_document import faults_of
from service.shapes.fields import split_tags
from service.shapes.schemas import ShapeFields

NAME, TAGS = "name", "tags"


@dataclass(frozen=True)
class About:
    """The tags and the metadata of a mesh."""

    tags: tuple[str, ...] = ()
    metadata: dict[str, str] | None = None


def read_metadata(path: Path) -> dict[str, About]:
    """The rows of a CSV file by their column `name`.

    The column holds the name of a file, with folders before it where names are repeated. The column `tags` is
    split at commas and semicolons. Every other column is a key; its empty cells are left out. Values stay
    text: a part number may begin with a zero.

    Raises
    ------
    DatasetError
        The file cannot be read, has no column `name`, names a mesh twice, or holds a value that no shape may
        have.
    """
    try:
        # Spreadsheets write a byte order mark, which would become part of the first column's name.
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True, strict=True)
            _check_columns(path, list(reader.fieldnames or ()))
            rows: dict[str, About] = {}
            for row in reader:
                name = (row[NAME] or "").strip().replace("\\", "/")
                if not name or name in rows:
                    told = f"{name} is listed twice" if name else "no name"
                    raise DatasetError(f"{path}, line {reader.line_num}: {told}")
                rows[name] = _about(path, reader.line_num, row)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}") from error
    return rows


def row_of(rows: dict[str, About], path: Path) -> str | None:
    """The name in the rows that fits a file, the longest if several fit."""
    parts = path.parts
    names = ("/".join(parts[start:]) for start in range(len(parts)))
    return next((name for name in names if name in rows), None)


def _check_columns(path: Path, columns: list[str]) -> None:
    if NAME not in columns:
        raise DatasetError(f"{path}: the first line must name the columns, {NAME} among them")
    if not all(columns) or len(set(columns)) < len(columns):
        raise DatasetError(f"{path}: a column has no name, or the name of another")


def _about(path: Path, line: int, row: dict[str, str | None]) -> About:
    if None in row or None in row.values():
        raise DatasetError(f"{path}, line {line}: not as many cells as there are columns")
    cells = {key: (cell or "").strip() for key, cell in row.items()}
    tags = split_tags([cells.pop(TAGS, "").replace(";", ",")])
    del cells[NAME]
    metadata = {key: cell for key, cell in cells.items() if cell}
    try:
        checked = ShapeFields.model_validate({"name": "any", "tags": tags, "metadata": metadata})
    except ValidationError as error:
        faults = "; ".join(f"{fault.field}: {fault.message}" for fault in faults_of(error.errors()))
        raise DatasetError(f"{path}, line {line}: {faults}") from error
    return About(tuple(checked.tags), metadata)
