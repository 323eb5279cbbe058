"""The tables of the database.

A blob holds the bytes of a file, once per SHA-256. A shape is a named record in one collection; several
shapes may share a blob. An embedding belongs to a blob, a format and a pipeline fingerprint, so that shapes
with the same bytes share it. A `checksum` (`service.storage.checksums`) covers the bytes of its row, the
fields, tags and metadata of a shape, or a pipeline.
"""

from datetime import datetime
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    JSON,
    ForeignKey,
    Index,
    LargeBinary,
    PrimaryKeyConstraint,
    String,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, MappedColumn, mapped_column

from service.storage.checksums import LENGTH
from service.storage.columns import AnyText, Number, UtcDateTime, Vector
from service.storage.words import WORD_CHARACTERS

_WHERE_NOT_DELETED: dict[str, Any] = {
    f"{dialect}_where": text("deleted_at IS NULL") for dialect in ("sqlite", "postgresql")
}


class Table(DeclarativeBase):
    """Base of every table."""

    type_annotation_map: ClassVar = {int: Number}


def _key_of(table: str) -> MappedColumn[int]:
    """Return a column of a primary key: the number of a row of another table, with which its row goes."""
    owner = ForeignKey(f"{table}.number", ondelete="CASCADE")
    return mapped_column(owner, primary_key=True, autoincrement=False)


class CollectionRow(Table):
    """A named set of shapes. The first one is `default`, which always exists.

    `rules` has tags by the conditions on metadata of the shapes that get them.
    """

    __tablename__ = "collections"
    __table_args__ = ({"sqlite_autoincrement": True},)

    number: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    rules: Mapped[dict[str, list[str]]] = mapped_column(JSON, default=dict)


class BlobRow(Table):
    """The bytes of a file, or NULL for those of a source's files, which stay in their folder."""

    __tablename__ = "blobs"
    __table_args__ = ({"sqlite_autoincrement": True},)

    number: Mapped[int] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(String(64), unique=True)
    size: Mapped[int]
    data: Mapped[bytes | None] = mapped_column(LargeBinary, deferred=True)


class ShapeRow(Table):
    """A stored shape.

    `number` increases and is never reused, so that it orders shapes by creation. `revision` is the revision
    of the archive in which the shape or its embedding was stored, whichever is later. A deleted shape has the
    time of its deletion until it is restored or erased; every query of shapes leaves it out by `NOT_DELETED`.
    """

    __tablename__ = "shapes"
    __table_args__ = (
        Index(
            "one_shape_a_name",
            "blob_number",
            "format",
            "name",
            "collection_number",
            unique=True,
            **_WHERE_NOT_DELETED,
        ),
        Index("shapes_by_blob", "blob_number", "format"),
        Index("shapes_by_revision", "revision"),
        Index("shapes_by_collection", "collection_number", "number", **_WHERE_NOT_DELETED),
        Index("shapes_by_deletion", "deleted_at"),
        Index("shapes_by_folded_name", "collection_number", "folded_name"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36), unique=True)
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number"))
    blob_number: Mapped[int] = mapped_column(ForeignKey("blobs.number"))
    format: Mapped[str] = mapped_column(String(8))
    name: Mapped[str] = mapped_column(String(255))
    folded_name: Mapped[str] = mapped_column(String(1024))
    meta: Mapped[dict[str, Any]] = mapped_column(JSON)
    facts: Mapped[dict[str, Any]] = mapped_column(JSON)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    updated_at: Mapped[datetime] = mapped_column(UtcDateTime)
    deleted_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    revision: Mapped[int]
    checksum: Mapped[str] = mapped_column(String(LENGTH))


NOT_DELETED = ShapeRow.deleted_at.is_(None)
"""The condition that a shape is not deleted."""


class TagRow(Table):
    """A tag of a shape and its position in the list of tags."""

    __tablename__ = "shape_tags"
    __table_args__ = (Index("shapes_by_tag", "tag", "shape_number"),)

    shape_number: Mapped[int] = _key_of("shapes")
    tag: Mapped[str] = mapped_column(String(64), primary_key=True)
    position: Mapped[int]


class MetadataRow(Table):
    """A scalar value of a shape's metadata as text, for filters."""

    __tablename__ = "shape_metadata"
    # Values may exceed the limit of an ordered index in PostgreSQL.
    __table_args__ = (
        Index("shapes_by_metadata", "key", "value", "shape_number").ddl_if(dialect="sqlite"),
        Index("shapes_by_metadata_value", "value", postgresql_using="hash").ddl_if(dialect="postgresql"),
    )

    shape_number: Mapped[int] = _key_of("shapes")
    key: Mapped[str] = mapped_column(AnyText, primary_key=True)
    value: Mapped[str] = mapped_column(AnyText)


_Word = String(WORD_CHARACTERS).with_variant(String(WORD_CHARACTERS, collation="C"), "postgresql")
"""A folded word, in the order of its characters, so that an index finds the words with a beginning."""


class WordRow(Table):
    """A word or a run that a shape has (`service.storage.words`), and the same `backward`."""

    __tablename__ = "words"
    __table_args__ = ({"sqlite_autoincrement": True},)

    number: Mapped[int] = mapped_column(primary_key=True)
    word: Mapped[str] = mapped_column(_Word, unique=True)
    backward: Mapped[str] = mapped_column(_Word, index=True)


class ShapeWordRow(Table):
    """A word of a shape, with the largest weight of the fields that have it.

    Plain rows serve both databases with the same answers. They find beginnings, parts and misspellings, for
    which the full-text search of SQLite and that of PostgreSQL need different indexes besides their own.
    """

    __tablename__ = "shape_words"
    __table_args__ = (
        # PostgreSQL would read the weights of the shapes of a word from many pages.
        PrimaryKeyConstraint("word_number", "shape_number", postgresql_include=["weight"]),
        Index("words_by_shape", "shape_number", "word_number", "weight"),
        {"sqlite_with_rowid": False},
    )

    word_number: Mapped[int] = mapped_column(ForeignKey("words.number"))
    shape_number: Mapped[int] = mapped_column(ForeignKey("shapes.number", ondelete="CASCADE"))
    weight: Mapped[int]


class EmbeddingRow(Table):
    """The embedding of a blob in one format by one pipeline.

    The signature precedes the long record, so that a query of signatures does not read records. A number is
    never reused, so that a number in memory never refers to another embedding.
    """

    __tablename__ = "embeddings"
    __table_args__ = (
        UniqueConstraint("blob_number", "format", "fingerprint", name="one_embedding_a_pipeline"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    blob_number: Mapped[int] = mapped_column(ForeignKey("blobs.number", ondelete="CASCADE"))
    format: Mapped[str] = mapped_column(String(8))
    fingerprint: Mapped[str] = mapped_column(String(16))
    signature: Mapped[NDArray[np.float32]] = mapped_column(Vector("<f4"))
    record: Mapped[bytes] = mapped_column(LargeBinary, deferred=True)
    checksum: Mapped[str] = mapped_column(String(LENGTH), deferred=True)


class CoarseSamplesRow(Table):
    """Short descriptors of an embedding, which a search reads of all.

    `data` has the coarse samples (`core.ranking.reranking`), `signature` is a copy of the signature,
    `view_signature` is that of `core.descriptors.views` and `reliability` that of
    `core.descriptors.facts`.

    A service loads them for all embeddings at its start. This table stores them densely: reading signatures
    from `embeddings` would read a page of each record.
    """

    __tablename__ = "coarse_samples"

    embedding_number: Mapped[int] = _key_of("embeddings")
    data: Mapped[bytes] = mapped_column(LargeBinary)
    signature: Mapped[bytes] = mapped_column(LargeBinary)
    view_signature: Mapped[NDArray[np.uint8]] = mapped_column(Vector("u1"))
    reliability: Mapped[float]
    checksum: Mapped[str] = mapped_column(String(LENGTH))


class PieceRow(Table):
    """A kind of the pieces of an embedding's surface: a row of `core.descriptors.pieces`.

    `size` is the square root of the area of one piece, `lengths` the whole row in little-endian float32, and
    `of_several` whether the surface has several pieces. The index alone answers which have a size.
    """

    __tablename__ = "pieces"
    __table_args__ = (Index("pieces_by_size", "of_several", "size", "embedding_number", "lengths"),)

    embedding_number: Mapped[int] = _key_of("embeddings")
    place: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    of_several: Mapped[bool]
    size: Mapped[float]
    lengths: Mapped[bytes]


class RemovalRow(Table):
    """The number of a deleted or erased shape, for processes that still have its signature in memory."""

    __tablename__ = "removals"

    shape_number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    revision: Mapped[int] = mapped_column(index=True)


class PipelineRow(Table):
    """A pipeline with embeddings: the version of the method and the parameters."""

    __tablename__ = "pipelines"

    fingerprint: Mapped[str] = mapped_column(String(16), primary_key=True)
    method: Mapped[int]
    parameters: Mapped[dict[str, Any]] = mapped_column(JSON)
    checksum: Mapped[str] = mapped_column(String(LENGTH))


class IdempotencyKeyRow(Table):
    """The answer to a request with an Idempotency-Key, for its repetitions.

    `scope` is the digest of the client's API key, or empty; `payload` is a hash of the request.
    """

    __tablename__ = "idempotency_keys"

    collection_number: Mapped[int] = _key_of("collections")
    scope: Mapped[str] = mapped_column(String(64), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    payload: Mapped[str] = mapped_column(String(64))
    status: Mapped[int]
    location: Mapped[str] = mapped_column(String(255))
    body: Mapped[str] = mapped_column(Text)
    expires_at: Mapped[datetime] = mapped_column(UtcDateTime, index=True)


class ArchiveRow(Table):
    """The only row about the archive itself.

    `revision` counts changes of searchable data. `fingerprint` identifies the active pipeline; NULL before
    the first start of a service.
    """

    __tablename__ = "archive"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    revision: Mapped[int]
    fingerprint: Mapped[str | None] = mapped_column(String(16))


class ThumbnailRow(Table):
    """A picture of a blob in one format, of `size` by `size` pixels, by version `drawing` of the renderer."""

    __tablename__ = "thumbnails"

    blob_number: Mapped[int] = _key_of("blobs")
    format: Mapped[str] = mapped_column(String(8), primary_key=True)
    size: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    drawing: Mapped[int]
    data: Mapped[bytes] = mapped_column(LargeBinary)
    checksum: Mapped[str] = mapped_column(String(LENGTH))


class DuplicatePairRow(Table):
    """Two shapes of one collection of which the second is a rigid copy, or a variant, of the first.

    `fingerprint` identifies the pipeline that computed `cc`. `residual` is their distance after registration
    over the root of the area, and `scale` a length in the second over that in the first. A variant has the
    `difference` of the second, as `core.registration.rigid_copy.Difference` names its fields.
    """

    __tablename__ = "duplicate_pairs"
    __table_args__ = (Index("duplicate_pairs_by_second", "second_number"),)

    first_number: Mapped[int] = _key_of("shapes")
    second_number: Mapped[int] = _key_of("shapes")
    fingerprint: Mapped[str] = mapped_column(String(16), primary_key=True)
    cc: Mapped[float]
    residual: Mapped[float]
    scale: Mapped[float]
    mirrored: Mapped[bool]
    variant: Mapped[bool]
    difference: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))


class JudgedShapeRow(Table):
    """A shape that has been compared with all other judged shapes of its collection.

    `variants` tells a search for variants from one for copies. Pairs with at most `max_residual` were
    found. `compared` and `aligned` count the compared and the registered pairs. `number`
    orders the rows by time.
    """

    __tablename__ = "judged_shapes"
    __table_args__ = (
        UniqueConstraint("shape_number", "fingerprint", "variants", name="one_judgement_a_search"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    shape_number: Mapped[int] = mapped_column(ForeignKey("shapes.number", ondelete="CASCADE"))
    fingerprint: Mapped[str] = mapped_column(String(16))
    variants: Mapped[bool]
    max_residual: Mapped[float]
    compared: Mapped[int]
    aligned: Mapped[int]


class DuplicateDecisionRow(Table):
    """A decision on two files of one collection, of which the first has the lesser SHA-256.

    The hashes keep it when shapes are embedded again, renamed, or deleted and stored again; another file is
    not decided. The rows of one act of deciding, as on a group of three shapes, share its `id`.
    """

    __tablename__ = "duplicate_decisions"
    __table_args__ = (
        UniqueConstraint("collection_number", "first_sha256", "second_sha256", name="one_decision_a_pair"),
        Index("duplicate_decisions_by_id", "id"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36))
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number", ondelete="CASCADE"))
    first_sha256: Mapped[str] = mapped_column(String(64))
    second_sha256: Mapped[str] = mapped_column(String(64))
    decision: Mapped[Literal["same", "variant", "different", "ignore"]] = mapped_column(String(16))
    decided_by: Mapped[str | None] = mapped_column(String(64))
    reason: Mapped[str] = mapped_column(String(1024))
    decided_at: Mapped[datetime] = mapped_column(UtcDateTime)


class DuplicateMergeRow(Table):
    """What undoes a merge of shapes of one collection, as long as the deleted shapes can be restored.

    `shape` is the id of the shape that stayed, with the `sha256` of its file, and its former `tags` and
    `meta`. `deleted` has the ids of the others. The rows of all groups that a rule merges share their `id`.
    """

    __tablename__ = "duplicate_merges"
    __table_args__ = (
        Index("duplicate_merges_by_id", "collection_number", "id", "number"),
        Index("duplicate_merges_by_time", "merged_at"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36))
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number", ondelete="CASCADE"))
    shape: Mapped[str] = mapped_column(AnyText(36))
    sha256: Mapped[str] = mapped_column(String(64))
    tags: Mapped[list[str]] = mapped_column(JSON)
    meta: Mapped[dict[str, Any]] = mapped_column(JSON)
    deleted: Mapped[list[str]] = mapped_column(JSON)
    merged_at: Mapped[datetime] = mapped_column(UtcDateTime)


class NeighboursRow(Table):
    """The nearest neighbours of a shape in its collection, by the log odds of one pipeline.

    `data` has them as `service.index.neighbour_repository` says, the likeliest first. A number that has no
    row itself is that of a deleted shape, and does not count; numbers are never reused.
    """

    __tablename__ = "neighbours"

    shape_number: Mapped[int] = _key_of("shapes")
    fingerprint: Mapped[str] = mapped_column(String(16), primary_key=True)
    data: Mapped[bytes] = mapped_column(LargeBinary)
    checksum: Mapped[str] = mapped_column(String(LENGTH))


class JobRow(Table):
    """A bulk job, which stores the members of an archive.

    `client` is the digest of the key that sent the archive, or the address without keys.
    `number` increases in the order of creation. `state` is one of `service.jobs.schemas.State`. `runner`
    identifies the service that runs the job; it counts as dead after `leased_until`. Until the job ends, its
    archive is a file (`service.jobs.service.Jobs.archive_path`). `told`: a webhook has told its end.
    """

    __tablename__ = "jobs"
    __table_args__ = (
        Index("jobs_by_state", "state"),
        Index("jobs_by_collection", "collection_number", "number"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36), unique=True)
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number"))
    client: Mapped[str] = mapped_column(String(64))
    state: Mapped[str] = mapped_column(String(16))
    archive: Mapped[str] = mapped_column(String(255))
    size: Mapped[int]
    tags: Mapped[list[str]] = mapped_column(JSON)
    meta: Mapped[dict[str, Any]] = mapped_column(JSON)
    kind: Mapped[str | None] = mapped_column(String(64))
    detail: Mapped[str | None] = mapped_column(Text)
    runner: Mapped[str | None] = mapped_column(String(36))
    leased_until: Mapped[datetime | None] = mapped_column(UtcDateTime)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    started_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    ended_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    told: Mapped[bool] = mapped_column(default=False)


class JobFileRow(Table):
    """A member of a job's archive and its outcome, which is NULL until the member is processed."""

    __tablename__ = "job_files"
    __table_args__ = (Index("job_files_by_outcome", "job_number", "outcome", "position"),)

    job_number: Mapped[int] = _key_of("jobs")
    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    path: Mapped[str] = mapped_column(String(1024))
    name: Mapped[str] = mapped_column(String(1024))
    outcome: Mapped[str | None] = mapped_column(String(16))
    shape_id: Mapped[str | None] = mapped_column(String(36))
    kind: Mapped[str | None] = mapped_column(String(64))
    detail: Mapped[str | None] = mapped_column(Text)
    ended_at: Mapped[datetime | None] = mapped_column(UtcDateTime)


class SourceRow(Table):
    """A folder whose mesh files are shapes of a collection and stay where they are.

    `root` is the folder's real path. With `copies`, the archive keeps the bytes too. `rules` has tags by the
    patterns of paths whose files get them; it is `tagged` once all its shapes have those tags. `state` is one
    of `service.sources.schemas.State`, `detail` the reason of `offline`, and `report` the counts of the
    latest scan. `requested` asks for a scan; `confirmed` lets it take files for deleted that an absent folder
    lacks. `runner` identifies the service that scans; it counts as dead after `leased_until`. A source with
    `removed_at` is kept until its shapes are erased; its `state` is `removed` once they are deleted.
    """

    __tablename__ = "sources"
    __table_args__ = (
        Index("sources_by_collection", "collection_number", "name"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36), unique=True)
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number"))
    name: Mapped[str] = mapped_column(AnyText(255))
    root: Mapped[str] = mapped_column(AnyText)
    copies: Mapped[bool]
    tags: Mapped[list[str]] = mapped_column(JSON)
    rules: Mapped[dict[str, list[str]]] = mapped_column(JSON)
    tagged: Mapped[bool]
    state: Mapped[str] = mapped_column(String(16))
    detail: Mapped[str | None] = mapped_column(Text)
    report: Mapped[dict[str, Any]] = mapped_column(JSON)
    requested: Mapped[bool]
    confirmed: Mapped[bool]
    runner: Mapped[str | None] = mapped_column(String(36))
    leased_until: Mapped[datetime | None] = mapped_column(UtcDateTime)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    scanned_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    removed_at: Mapped[datetime | None] = mapped_column(UtcDateTime)


class SourceFileRow(Table):
    """A file of a source, as the latest scan that read it found it.

    `path` is relative to the root, as the disk spells it, and `key` its normal form NFC. Several files may
    have one shape. `owned` tells that a source stored the shape; it is NULL for a refused file, and for one
    whose shape was erased. `state` is one of `service.sources.schemas.FileState`. `device` and `inode` are
    signed, as databases have them.
    """

    __tablename__ = "source_files"
    __table_args__ = (
        UniqueConstraint("source_number", "key", name="one_file_a_path"),
        Index("source_files_by_state", "source_number", "state", "number"),
        Index("source_files_by_number", "source_number", "number"),
        Index("source_files_by_sha256", "sha256"),
        Index("source_files_by_shape", "shape_number", "source_number", "number"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    source_number: Mapped[int] = mapped_column(ForeignKey("sources.number", ondelete="CASCADE"))
    path: Mapped[str] = mapped_column(AnyText)
    key: Mapped[str] = mapped_column(AnyText)
    size: Mapped[int]
    mtime_ns: Mapped[int]
    device: Mapped[int]
    inode: Mapped[int]
    sha256: Mapped[str | None] = mapped_column(String(64))
    shape_number: Mapped[int | None] = mapped_column(ForeignKey("shapes.number", ondelete="SET NULL"))
    owned: Mapped[bool]
    state: Mapped[str] = mapped_column(String(16))
    kind: Mapped[str | None] = mapped_column(String(64))
    detail: Mapped[str | None] = mapped_column(Text)
    missing_since: Mapped[datetime | None] = mapped_column(UtcDateTime)


class WebhookRow(Table):
    """What a webhook has told of one kind of rows, and the message that is not delivered yet.

    `told` is the number of the last row that messages have told of. A message has an `id`, which all attempts
    to deliver it share, and a `body`; `due_at` is the time of the next attempt.
    """

    __tablename__ = "webhooks"

    kind: Mapped[str] = mapped_column(String(32), primary_key=True)
    told: Mapped[int]
    id: Mapped[str | None] = mapped_column(String(64))
    body: Mapped[str | None] = mapped_column(Text, deferred=True)
    attempts: Mapped[int]
    due_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
