"""Copies of archives between SQLite and PostgreSQL, row by row.

One transaction writes the whole target, or nothing. Before it commits, every row of the target is read again
and compared with the source.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from datetime import datetime
from typing import Any

import numpy as np
from alembic.migration import MigrationContext
from sqlalchemy import Connection, LargeBinary, Row, Table, func, insert, inspect, select, text

from service.errors import ArchiveError
from service.storage.checking import CheckReport
from service.storage.columns import POSTGRESQL
from service.storage.database import Database, check_known, migrate
from service.storage.postgresql import ensure_hnsw
from service.storage.tables import (
    NOT_DELETED,
    ArchiveRow,
    BlobRow,
    CollectionRow,
    EmbeddingRow,
    PipelineRow,
    WebhookRow,
)
from service.storage.tables import Table as ArchiveTable

ROWS_AT_ONCE = 500
BYTES_AT_ONCE = 16 * 1024**2
# Tables with rows that migrations, and the first start of a service, write into an empty archive.
WRITTEN_AT_THE_START = {row.__tablename__ for row in (ArchiveRow, CollectionRow, PipelineRow, WebhookRow)}

_TABLES = ArchiveTable.metadata

Advance = Callable[[str, int, int], object]


def copy_archive(source: Database, target: Database, advance: Advance) -> CheckReport:
    """Copy a whole archive into another database, which must be empty; return the numbers of what is copied.

    The copy shows one moment. Other processes may write to a PostgreSQL source meanwhile; writers to an
    SQLite source wait. `advance` is called with the name of a table, the number of its copied rows and the
    number of all its rows.

    Raise ArchiveError if the source is not an archive of this version, the target is not empty, or the copy
    differs.
    """
    migrate(target)
    with source.read() as reading, target.write() as writing:
        origin, copy = reading.connection(), writing.connection()
        _check_source(origin)
        _check_empty(copy)
        for table in reversed(_TABLES.sorted_tables):
            copy.execute(table.delete())
        for table in _TABLES.sorted_tables:
            total = origin.execute(select(func.count()).select_from(table)).scalar_one()
            copied = digests = 0
            for rows in _batches(origin, table):
                for row in rows:
                    _check_bytes(table, row)
                    digests += _digest(row)
                copy.execute(insert(table), [dict(row._mapping) for row in rows])
                copied += len(rows)
                advance(table.name, copied, total)
            # A sum, because the rows of the copy may have another order.
            if sum(_digest(row) for rows in _batches(copy, table) for row in rows) != digests:
                raise ArchiveError(
                    f"the copy of the table {table.name} is not the same; nothing was kept of it"
                )
            _continue_numbering(origin, copy, table)
        for fingerprint in writing.scalars(select(EmbeddingRow.fingerprint).distinct()).all():
            ensure_hnsw(writing, fingerprint)
        if copy.dialect.name == POSTGRESQL:
            # Without statistics the planner of PostgreSQL takes the tables for empty.
            copy.execute(text("ANALYZE"))
        shapes = copy.execute(select(func.count()).where(NOT_DELETED)).scalar_one()
        blobs, embeddings = (
            copy.execute(select(func.count()).select_from(row)).scalar_one()
            for row in (BlobRow, EmbeddingRow)
        )
        total = copy.execute(select(func.sum(func.length(BlobRow.data)))).scalar_one()
        return CheckReport(shapes, blobs, embeddings, int(total or 0))


def _check_source(origin: Connection) -> None:
    """Raise unless the source is an archive of this version without unknown tables."""
    present = set(inspect(origin).get_table_names())
    if "alembic_version" not in present:
        raise ArchiveError("the source is no Isoshape archive")
    check_known(MigrationContext.configure(origin).get_current_heads())
    unknown = present - {"alembic_version", "sqlite_sequence"} - set(_TABLES.tables)
    if unknown:
        raise ArchiveError(f"the source has tables that are not an archive's: {', '.join(sorted(unknown))}")


def _check_empty(copy: Connection) -> None:
    for table in _TABLES.sorted_tables:
        rows = copy.execute(select(func.count()).select_from(table)).scalar_one()
        if rows and table.name not in WRITTEN_AT_THE_START:
            raise ArchiveError(f"the target is not empty: it has {rows} rows in its table {table.name}")


def _batches(connection: Connection, table: Table) -> Iterator[list[Row[Any]]]:
    """Yield the rows of a table in batches of bounded size."""
    # PostgreSQL uses a server-side cursor, so that only one batch is in memory.
    query = select(table).execution_options(yield_per=_at_once(connection, table))
    for rows in connection.execute(query).partitions():
        yield list(rows)


def _at_once(connection: Connection, table: Table) -> int:
    """Return the number of rows in a batch, from the longest row of the table."""
    lengths = [func.max(func.length(each)) for each in table.columns if isinstance(each.type, LargeBinary)]
    longest = connection.execute(select(*lengths)).one() if lengths else ()
    return max(1, min(ROWS_AT_ONCE, BYTES_AT_ONCE // max(1, sum(length or 0 for length in longest))))


def _check_bytes(table: Table, row: Row[Any]) -> None:
    """Raise unless the bytes of a row have their SHA-256. SQLite could also return text."""
    if not {"data", "sha256"} <= set(table.columns.keys()) or row.data is None:
        return
    if not isinstance(row.data, bytes) or hashlib.sha256(row.data).hexdigest() != row.sha256:
        raise ArchiveError(
            f"{table.name} row {row.number} of the source does not have the SHA-256 {row.sha256}"
        )


def _continue_numbering(origin: Connection, copy: Connection, table: Table) -> None:
    """Have the target continue the numbering of the source, so that no number is used twice."""
    if not table.dialect_options["sqlite"]["autoincrement"]:
        return
    last = _last_number(origin, table)
    if not last:
        return
    if copy.dialect.name == POSTGRESQL:
        copy.execute(select(func.setval(_sequence(table), last)))
        return
    name = {"name": table.name}
    copy.execute(text("DELETE FROM sqlite_sequence WHERE name = :name"), name)
    copy.execute(
        text("INSERT INTO sqlite_sequence (name, seq) VALUES (:name, :last)"), {**name, "last": last}
    )


def _last_number(connection: Connection, table: Table) -> int:
    """Return the last number that a table has generated, even if its row is deleted; 0 before the first."""
    if connection.dialect.name == POSTGRESQL:
        last = text(f"SELECT CASE WHEN is_called THEN last_value ELSE 0 END FROM {_sequence(table)}")
        return int(connection.execute(last).scalar_one())
    sequence = connection.execute(
        text("SELECT seq FROM sqlite_sequence WHERE name = :name"), {"name": table.name}
    )
    return int(sequence.scalar() or 0)


def _sequence(table: Table) -> str:
    """Return the name of the PostgreSQL sequence that numbers a table's rows."""
    return f"{table.name}_number_seq"


def _digest(row: Row[Any]) -> int:
    """Return the SHA-256 of a row as a number, equal on both databases."""
    values = {str(name): _plain(value) for name, value in row._mapping.items()}
    return int.from_bytes(hashlib.sha256(json.dumps(values, sort_keys=True).encode()).digest(), "big")


def _plain(value: object) -> object:
    """Return the JSON value of a column."""
    if isinstance(value, bytes):
        return hashlib.sha256(value).hexdigest()
    if isinstance(value, np.ndarray):
        return value.tobytes().hex()
    return value.isoformat() if isinstance(value, datetime) else value
