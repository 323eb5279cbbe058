"""The SQL that fills archives for benchmarks."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import insert, update

from service.storage.database import WriteSession
from service.storage.tables import (
    ArchiveRow,
    BlobRow,
    CoarseSamplesRow,
    EmbeddingRow,
    QuantisedPointsRow,
    ShapeRow,
)

Row = dict[str, Any]


TABLES = (BlobRow, ShapeRow, EmbeddingRow, CoarseSamplesRow, QuantisedPointsRow)


def add(session: WriteSession, rows: Sequence[Sequence[Row]], revision: int) -> None:
    """Insert rows into each of the `TABLES`, and set the revision of the archive."""
    for table, of_table in zip(TABLES, rows, strict=True):
        session.execute(insert(table), of_table)
    session.execute(update(ArchiveRow).values(revision=revision))
