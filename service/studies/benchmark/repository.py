"""The SQL of archives that are made to be measured."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import insert, update

from service.storage.database import WriteSession
from service.storage.tables import ArchiveRow, BlobRow, EmbeddingRow, ShapeRow, SketchRow

Row = dict[str, Any]


TABLES = (BlobRow, ShapeRow, EmbeddingRow, SketchRow)


def add(session: WriteSession, rows: Sequence[Sequence[Row]], revision: int) -> None:
    """Write the rows of each of the `TABLES` as they are, and the revision that the last shape has."""
    for table, of_table in zip(TABLES, rows, strict=True):
        session.execute(insert(table), of_table)
    session.execute(update(ArchiveRow).values(revision=revision))
