"""An archive copied from one engine to the other, row by row.

All that is written is one transaction, so that the target holds the whole archive or nothing. Before it is
committed the target is read again, and every row compared with the source's.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from alembic.migration import MigrationContext
from sqlalchemy import Connection, LargeBinary, Row, Table, func, insert, inspect, select, text

from service.errors import ArchiveError
from service.storage.columns import POSTGRESQL
from service.storage.database import Database
from service.storage.hnsw import ensure_hnsw
from service.storage.job_tables import JobRow
from service.storage.migrate import check_known, head, migrate
from service.storage.tables import ArchiveRow, BlobRow, CollectionRow, EmbeddingRow, PipelineRow, ShapeRow

ROWS_AT_ONCE = 500
BYTES_AT_ONCE = 16 * 1024**2
# What migrations write, and a service as soon as it starts on an empty archive.
WRITTEN_AT_THE_START = {ArchiveRow.__tablename__, CollectionRow.__tablename__, PipelineRow.__tablename__}

# Of jobs too, once the module of their tables is imported.
_TABLES = JobRow.metadata

Advance = Callable[[str, int, int], object]


@dataclass(frozen=True)
class Copied:
    """What was copied: how many shapes, blobs and embeddings, and the bytes of all blobs."""

    shapes: int
    blobs: int
    embeddings: int
    bytes: int


@dataclass(frozen=True)
class _Content:
    """Some rows: how many, and the sum of their SHA-256 modulo 2^256, which no order changes."""

    rows: int = 0
    digest: int = 0

    def with_row(self, row: Row[Any]) -> "_Content":
        return _Content(self.rows + 1, (self.digest + _digest(row)) % 2**256)


def copy_archive(source: Database, target: Database, advance: Advance) -> Copied:
    """Copy everything from one archive into another, which is empty.

    The copy is of one moment. A PostgreSQL source may be written meanwhile; those who write to a source that
    is a file wait.

    Parameters
    ----------
    source, target : Database
    advance : callable
        Told the name of a table, how many of its rows were copied, and how many there are.

    Raises
    ------
    ArchiveError
        The source is no archive of this version, the target is not empty, or the copy is not the same.
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
            copied = _Content()
            for rows in _batches(origin, table):
                for row in rows:
                    if table.name == BlobRow.__tablename__:
                        _check_bytes(row)
                    copied = copied.with_row(row)
                copy.execute(insert(table), [dict(row._mapping) for row in rows])
                advance(table.name, copied.rows, total)
            _check_same(copy, table, copied)
            _go_on_counting(origin, copy, table)
        for fingerprint in writing.scalars(select(EmbeddingRow.fingerprint).distinct()).all():
            ensure_hnsw(writing, fingerprint)
        if copy.dialect.name == POSTGRESQL:
            # Or queries are planned for empty tables until the server looks at them by itself.
            copy.execute(text("ANALYZE"))
        shapes, blobs, embeddings = (
            copy.execute(select(func.count()).select_from(row)).scalar_one()
            for row in (ShapeRow, BlobRow, EmbeddingRow)
        )
        total = copy.execute(select(func.sum(BlobRow.size))).scalar_one()
        return Copied(shapes, blobs, embeddings, int(total or 0))


def _check_source(origin: Connection) -> None:
    """Raise unless the source is an archive of this version, of whose tables this code knows all."""
    present = set(inspect(origin).get_table_names())
    if "alembic_version" not in present:
        raise ArchiveError("the source is no Isoshape archive")
    versions = MigrationContext.configure(origin).get_current_heads()
    check_known(versions)
    if versions != (head(),):
        raise ArchiveError("the source is of an older Isoshape: start a service on it once, then copy it")
    unknown = present - {"alembic_version", "sqlite_sequence"} - set(_TABLES.tables)
    if unknown:
        raise ArchiveError(f"the source has tables that are not an archive's: {', '.join(sorted(unknown))}")


def _check_empty(copy: Connection) -> None:
    for table in _TABLES.sorted_tables:
        rows = copy.execute(select(func.count()).select_from(table)).scalar_one()
        if rows and table.name not in WRITTEN_AT_THE_START:
            raise ArchiveError(f"the target is not empty: it has {rows} rows in its table {table.name}")


def _batches(connection: Connection, table: Table) -> Iterator[list[Row[Any]]]:
    """The rows of a table, so many at a time that they have few bytes."""
    # From PostgreSQL by a cursor of the server's: no more rows than these are in memory.
    query = select(table).execution_options(yield_per=_at_once(connection, table))
    for rows in connection.execute(query).partitions():
        yield list(rows)


def _at_once(connection: Connection, table: Table) -> int:
    """How many rows to hold in memory, by the longest bytes that one of them has."""
    lengths = [func.max(func.length(each)) for each in table.columns if isinstance(each.type, LargeBinary)]
    longest = connection.execute(select(*lengths)).one() if lengths else ()
    return max(1, min(ROWS_AT_ONCE, BYTES_AT_ONCE // max(1, sum(length or 0 for length in longest))))


def _check_bytes(blob: Row[Any]) -> None:
    """Raise unless a blob is what its SHA-256 says. In SQLite it might even be text."""
    if not isinstance(blob.data, bytes) or hashlib.sha256(blob.data).hexdigest() != blob.sha256:
        raise ArchiveError(f"blob {blob.number} of the source does not have the SHA-256 {blob.sha256}")


def _check_same(copy: Connection, table: Table, copied: _Content) -> None:
    """Read the rows again, and compare."""
    found = _Content()
    for rows in _batches(copy, table):
        for row in rows:
            found = found.with_row(row)
    if found != copied:
        raise ArchiveError(f"the copy of the table {table.name} is not the same; nothing was kept of it")


def _go_on_counting(origin: Connection, copy: Connection, table: Table) -> None:
    """Have the target give no number again that the source once gave."""
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
    """The last number that was given to a row of a table, which may be there no more; 0 before the first."""
    if connection.dialect.name == POSTGRESQL:
        last = text(f"SELECT CASE WHEN is_called THEN last_value ELSE 0 END FROM {_sequence(table)}")
        return int(connection.execute(last).scalar_one())
    found = connection.execute(
        text("SELECT seq FROM sqlite_sequence WHERE name = :name"), {"name": table.name}
    )
    return int(found.scalar() or 0)


def _sequence(table: Table) -> str:
    """PostgreSQL's name for what counts a table's rows."""
    return f"{table.name}_number_seq"


def _digest(row: Row[Any]) -> int:
    """The SHA-256 of a row, as a number; the same whatever engine it was read from."""
    values = {str(name): _plain(value) for name, value in row._mapping.items()}
    return int.from_bytes(hashlib.sha256(json.dumps(values, sort_keys=True).encode()).digest(), "big")


def _plain(value: object) -> object:
    """A value as JSON."""
    if isinstance(value, bytes):
        return hashlib.sha256(value).hexdigest()
    if isinstance(value, np.ndarray):
        return value.tobytes().hex()
    return value.isoformat() if isinstance(value, datetime) else value
