"""Checks of an archive: its file, its references, and the checksums of its blobs, embeddings and shapes.

Each batch of blobs or embeddings is read in its own transaction: a service may write between two batches.
"""

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy.dialects.sqlite import dialect

from core.descriptors.facts import intrinsic_reliability
from core.descriptors.pieces import SIZE, number_of_pieces
from core.descriptors.views import view_signature
from core.errors import BadRecordError
from core.serialization import embedding_from_bytes
from service.errors import ArchiveError
from service.storage.checksums import SHAPE_COLUMNS, SHAPE_TIMES, is_whole, pipeline_checksum, shape_checksum
from service.storage.database import check_known
from service.storage.tables import Table
from service.storage.words import MOST_PATHS, words_of

# Writers wait while a batch is read.
BLOBS_AT_ONCE = 8
EMBEDDINGS_AT_ONCE = 256
MOST_INTEGRITY_FAULTS = 100

# Other tables with bytes in their column `data`: the key that orders the rows.
OTHER_BYTES = {"coarse_samples": "embedding_number", "thumbnails": "rowid", "neighbours": "rowid"}

REFERENCES = {
    "blob {} has no shape": """
        SELECT number FROM blobs
        WHERE NOT EXISTS (SELECT 1 FROM shapes WHERE shapes.blob_number = blobs.number)""",
    "shape {} has no embedding": """
        SELECT id FROM shapes
        WHERE NOT EXISTS (SELECT 1 FROM embeddings WHERE embeddings.blob_number = shapes.blob_number
                          AND embeddings.format = shapes.format)""",
    "embedding {} has no shape": """
        SELECT number FROM embeddings
        WHERE NOT EXISTS (SELECT 1 FROM shapes WHERE shapes.blob_number = embeddings.blob_number
                          AND shapes.format = embeddings.format)""",
    "embedding {} has no coarse samples": """
        SELECT number FROM embeddings
        WHERE NOT EXISTS (SELECT 1 FROM coarse_samples WHERE embedding_number = embeddings.number)""",
    "embedding {} has another signature beside its coarse samples": """
        SELECT number FROM embeddings JOIN coarse_samples ON embedding_number = embeddings.number
        WHERE coarse_samples.signature <> embeddings.signature""",
    "word {} is of no shape": """
        SELECT number FROM words
        WHERE NOT EXISTS (SELECT 1 FROM shape_words WHERE word_number = words.number)""",
    "shape {} is there, and is among those that were deleted": """
        SELECT id FROM shapes JOIN removals ON shape_number = number WHERE deleted_at IS NULL""",
    "shape {} is deleted, and is not among those that were deleted": """
        SELECT id FROM shapes WHERE deleted_at IS NOT NULL
        AND NOT EXISTS (SELECT 1 FROM removals WHERE shape_number = number)""",
    "shape {} has a revision that the archive has not reached": """
        SELECT id FROM shapes WHERE revision > (SELECT max(revision) FROM archive)""",
    "the removal of shape number {} has a revision that the archive has not reached": """
        SELECT shape_number FROM removals WHERE revision > (SELECT max(revision) FROM archive)""",
    "the archive has {} rows about itself, not one": """
        SELECT n FROM (SELECT count(*) AS n FROM archive) WHERE n <> 1""",
    "the first collection is not default, but {}": """
        SELECT coalesce((SELECT name FROM collections WHERE number = 1), 'not there') AS first
        WHERE first <> 'default'""",
}
"""Faults, each with a query that finds them."""


DAMAGED = (sqlite3.Error, UnicodeDecodeError)
"""Errors of a damaged file: SQLite quotes its bytes, which may be no UTF-8."""


@dataclass
class CheckReport:
    """The content of an archive and its faults.

    `bytes` is the total size of the blobs, and `pipelines` has the number of embeddings of each fingerprint.
    Each fault names the row or file that it concerns; a sound archive has none.
    """

    shapes: int = 0
    blobs: int = 0
    embeddings: int = 0
    bytes: int = 0
    pipelines: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def check(path: Path, *, lock_seconds: float) -> CheckReport:
    """Check the archive in a file; services may be using it.

    Raise ArchiveError if the file is not an archive, or a newer version wrote it.
    """
    with closing(connect(path, lock_seconds=lock_seconds)) as connection:
        check_version(connection, path)
        return _Check(connection).run()


class _Check:
    """The check of one archive. Each method checks one part, or yields the faults of one row."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._report = CheckReport()
        self._dimensions: dict[str, object] = {}

    def run(self) -> CheckReport:
        """Check all parts; a part that SQLite cannot read is a fault."""
        beside = "(SELECT {} FROM coarse_samples WHERE embedding_number = number)"
        descriptors = map(beside.format, ("embedding_number", "view_signature", "reliability"))
        embedding = ", ".join(("checksum", "fingerprint", "signature", "record", *descriptors))
        shape = ", ".join(("checksum", *SHAPE_COLUMNS, *SHAPE_TIMES))
        pipeline = "checksum, fingerprint, method, parameters"
        parts: list[Callable[[], None]] = [
            self._file,
            self._references,
            partial(self._rows, "blobs", "number", "sha256, size, data", BLOBS_AT_ONCE, self._blob),
            partial(self._rows, "embeddings", "number", embedding, EMBEDDINGS_AT_ONCE, self._embedding),
            partial(self._rows, "shapes", "number", shape, EMBEDDINGS_AT_ONCE, self._shape),
            partial(self._rows, "pipelines", "rowid", pipeline, EMBEDDINGS_AT_ONCE, self._pipeline),
        ]
        for table, key in OTHER_BYTES.items():
            faults_of = partial(self._bytes, table)
            parts.append(partial(self._rows, table, key, "data, checksum", BLOBS_AT_ONCE, faults_of))
        for part in parts:
            try:
                part()
            except DAMAGED as error:
                self._report.faults.append(f"the file cannot be read: {reason(error)}")
        return self._report

    def _file(self) -> None:
        """Check pages, indexes and constraints with SQLite's own check, then foreign keys."""
        faults = self._report.faults
        for (message,) in self._connection.execute(f"PRAGMA integrity_check({MOST_INTEGRITY_FAULTS})"):
            if message != "ok":
                faults.append(f"the file: {message}")
        # SQLite reads the statement of each table and index, and not the name of the table beside it.
        schema = self._connection.execute("SELECT type, name, tbl_name FROM sqlite_master").fetchall()
        tables = {name for kind, name, _ in schema if kind == "table"}
        for kind, name, table in schema:
            if table not in tables or (kind == "table" and name != table):
                faults.append(f"the file: the schema names another table beside the {kind} {name}")
        for known in Table.metadata.sorted_tables:
            types = {column.name: column.type.compile(dialect()) for column in known.columns}
            for _, name, kind, *_ in self._connection.execute(f"PRAGMA table_info({known.name})"):
                if types.get(name) != kind:
                    faults.append(f"the file: {known.name} has a column {name} of the type {kind}")
        for table, row, parent, _ in self._connection.execute("PRAGMA foreign_key_check"):
            faults.append(f"{table} row {row} refers to a row of {parent} that is not there")

    def _references(self) -> None:
        """Run the queries of `REFERENCES`, which foreign keys do not cover, in one transaction."""
        execute = self._connection.execute
        execute("BEGIN")
        try:
            query = "SELECT count(*) FROM shapes WHERE deleted_at IS NULL"
            (self._report.shapes,) = execute(query).fetchone()
            for fault, query in REFERENCES.items():
                self._report.faults.extend(fault.format(name) for (name,) in execute(query))
        finally:
            execute("ROLLBACK")

    def _rows(
        self, table: str, key: str, columns: str, at_once: int, faults_of: Callable[..., Iterator[str]]
    ) -> None:
        """Check all rows of a table in the order of their keys."""
        query = f"SELECT {key}, {columns} FROM {table} WHERE {key} > ? ORDER BY {key} LIMIT ?"
        last, more = -1, True
        while more:
            more = False
            for row in self._connection.execute(query, (last, at_once)):
                more, last = True, row[0]
                try:
                    self._report.faults.extend(faults_of(*row))
                except (TypeError, AttributeError, ValueError):
                    self._report.faults.append(f"{table} row {last} has a value of the wrong kind")

    def _blob(self, number: int, digest: str, size: int, data: bytes | None) -> Iterator[str]:
        self._report.blobs += 1
        if data is None:
            # The bytes are in the folder of a source, which may be on another machine.
            return
        self._report.bytes += len(data)
        if len(data) != size:
            yield f"blob {number} has {len(data)} bytes, not {size}"
        if sha256(data).hexdigest() != digest:
            yield f"blob {number} does not have the SHA-256 {digest}"

    def _embedding(
        self,
        number: int,
        checksum: str,
        fingerprint: str,
        signature: bytes,
        record: bytes,
        coarse_samples: int | None,
        *views: bytes | float | None,
    ) -> Iterator[str]:
        self._report.embeddings += 1
        self._report.pipelines[fingerprint] = self._report.pipelines.get(fingerprint, 0) + 1
        try:
            embedding = embedding_from_bytes(record)
        except BadRecordError as error:
            yield f"embedding {number} cannot be read: {error}"
            return
        own_views = view_signature(embedding.descriptors["views"]).tobytes()
        dimensions = (
            len(embedding.signature),
            [(spectrum.name, spectrum.coordinates.shape[1]) for spectrum in embedding.spectra],
        )
        faults = []
        if embedding.fingerprint != fingerprint:
            faults.append(f"is of {embedding.fingerprint}, and stored as one of {fingerprint}")
        if not np.array_equal(np.frombuffer(signature, np.uint8), embedding.signature.view(np.uint8)):
            faults.append("has a signature beside it that is not its own")
        if coarse_samples is not None and views != (own_views, intrinsic_reliability(embedding.facts)):
            faults.append("has views beside its coarse samples that are not its own")
        several = number_of_pieces(embedding.pieces) > 1
        own_pieces = [(several, float(lengths[SIZE]), lengths.tobytes()) for lengths in embedding.pieces]
        pieces = "SELECT of_several, size, lengths FROM pieces WHERE embedding_number = ? ORDER BY place"
        if self._connection.execute(pieces, [number]).fetchall() != own_pieces:
            faults.append("has pieces beside it that are not its own")
        if self._dimensions.setdefault(fingerprint, dimensions) != dimensions:
            faults.append(f"has other dimensions than the first of {fingerprint}")
        if not faults and not is_whole(record, checksum):
            faults.append("does not have its checksum")
        yield from (f"embedding {number} {fault}" for fault in faults)

    def _shape(self, number: int, checksum: str, *columns: object) -> Iterator[str]:
        tags = "SELECT tag FROM shape_tags WHERE shape_number = ? ORDER BY position"
        values = "SELECT key, value FROM shape_metadata WHERE shape_number = ?"
        shape = dict(zip((*SHAPE_COLUMNS, *SHAPE_TIMES), columns, strict=True))
        own_tags = [tag for (tag,) in self._connection.execute(tags, [number])]
        if shape_checksum(shape, own_tags, self._connection.execute(values, [number])) != checksum:
            yield f"shape {shape['id']} does not have its checksum"
            return
        words = "SELECT word, backward, weight FROM shape_words JOIN words ON number = word_number"
        indexed = self._connection.execute(f"{words} WHERE shape_number = ?", [number])
        paths = "SELECT path FROM source_files WHERE shape_number = ? ORDER BY source_number, number LIMIT ?"
        own_paths = [path for (path,) in self._connection.execute(paths, [number, MOST_PATHS])]
        own_words = words_of(str(shape["name"]), own_tags, json.loads(str(shape["meta"])), own_paths)
        if set(indexed) != {(word, word[::-1], weight) for word, weight in own_words.items()}:
            yield f"shape {shape['id']} is indexed by other words than its own"

    def _pipeline(self, _row: int, checksum: str, *pipeline: Any) -> Iterator[str]:  # noqa: ANN401
        if pipeline_checksum(*pipeline) != checksum:
            yield f"pipeline {pipeline[0]} does not have its checksum"

    def _bytes(self, table: str, number: int, data: bytes, checksum: str) -> Iterator[str]:
        if not is_whole(data, checksum):
            yield f"{table} row {number} does not have its checksum"


def connect(path: Path, *, lock_seconds: float) -> sqlite3.Connection:
    """Return a plain SQLite connection to an existing file; it rolls back transactions of killed processes.

    Raise ArchiveError if the file is missing, or is not a database.
    """
    if not path.is_file():
        raise ArchiveError(f"there is no archive at {path}")
    try:
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=lock_seconds, isolation_level=None
        )
    except DAMAGED as error:
        raise ArchiveError(f"{path} cannot be opened: {reason(error)}") from error
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except DAMAGED as error:
        connection.close()
        raise ArchiveError(f"{path} cannot be read: {reason(error)}") from error
    return connection


def check_version(connection: sqlite3.Connection, path: Path) -> None:
    """Raise ArchiveError unless the file is an archive that this version of the service knows."""
    try:
        versions = [row[0] for row in connection.execute("SELECT version_num FROM alembic_version")]
        connection.execute("SELECT revision FROM archive").fetchall()
    except DAMAGED as error:
        raise ArchiveError(f"{path} is no Isoshape archive: {reason(error)}") from error
    check_known(versions)


def reason(error: Exception) -> str:
    """Return the message of an SQLite error with the name of its code."""
    name = getattr(error, "sqlite_errorname", None)
    return f"{error} ({name})" if name else str(error)
