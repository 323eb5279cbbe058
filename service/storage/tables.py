"""The tables.

A blob is the bytes of a file, once per SHA-256. A shape is a record that people name, in one collection;
several may share a blob. An embedding belongs to a blob read in one format under one pipeline fingerprint, so
that shapes on the same bytes share it. Migrations make the tables; a test holds the two equal.
"""

from datetime import datetime
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import JSON, ForeignKey, Index, LargeBinary, String, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from service.storage.columns import AnyText, Float32Vector, Number, UtcDateTime


class Table(DeclarativeBase):
    """Base of every table."""

    type_annotation_map: ClassVar = {int: Number}


class CollectionRow(Table):
    """A named set of shapes. The first is `default`, and is always there."""

    __tablename__ = "collections"
    __table_args__ = ({"sqlite_autoincrement": True},)

    number: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(String(64), unique=True)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)


class BlobRow(Table):
    """The bytes of a file."""

    __tablename__ = "blobs"
    __table_args__ = ({"sqlite_autoincrement": True},)

    number: Mapped[int] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(String(64), unique=True)
    size: Mapped[int]
    data: Mapped[bytes] = mapped_column(LargeBinary, deferred=True)


class ShapeRow(Table):
    """A stored shape.

    `number` counts up and is never used again, so it orders shapes by creation. `revision` is that of the
    archive when the shape came, or when its embedding did, whichever was later.
    """

    __tablename__ = "shapes"
    __table_args__ = (
        UniqueConstraint("blob_number", "format", "name", "collection_number", name="one_shape_a_name"),
        Index("shapes_by_revision", "revision"),
        Index("shapes_by_collection", "collection_number", "number"),
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
    revision: Mapped[int]


class TagRow(Table):
    """A tag of a shape, and its place among them."""

    __tablename__ = "shape_tags"
    __table_args__ = (Index("shapes_by_tag", "tag", "shape_number"),)

    shape_number: Mapped[int] = mapped_column(
        ForeignKey("shapes.number", ondelete="CASCADE"), primary_key=True
    )
    tag: Mapped[str] = mapped_column(String(64), primary_key=True)
    place: Mapped[int]


class MetadataRow(Table):
    """A plain value in a shape's metadata, as text, to filter by."""

    __tablename__ = "shape_metadata"
    # A value may be longer than what an ordered index of PostgreSQL takes.
    __table_args__ = (
        Index("shapes_by_metadata", "key", "value", "shape_number").ddl_if(dialect="sqlite"),
        Index("shapes_by_metadata_value", "value", postgresql_using="hash").ddl_if(dialect="postgresql"),
    )

    shape_number: Mapped[int] = mapped_column(
        ForeignKey("shapes.number", ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(AnyText, primary_key=True)
    value: Mapped[str] = mapped_column(AnyText)


class EmbeddingRow(Table):
    """What a pipeline made of a blob.

    The signature stands before the record, which is long, so that reading it does not read that. A number is
    never used again, so that one held in memory cannot come to mean another embedding.
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
    signature: Mapped[NDArray[np.float32]] = mapped_column(Float32Vector)
    record: Mapped[bytes] = mapped_column(LargeBinary, deferred=True)


class SketchRow(Table):
    """The sketch of an embedding, see `core.ranking.coarse_ranking`, and its signature once more.

    Both are held in memory of all embeddings, so they lie close together: a start that took the signatures
    from among the records would read a page of each record.
    """

    __tablename__ = "sketches"

    embedding_number: Mapped[int] = mapped_column(
        ForeignKey("embeddings.number", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    data: Mapped[bytes] = mapped_column(LargeBinary)
    signature: Mapped[bytes] = mapped_column(LargeBinary)


class RemovalRow(Table):
    """A shape that was deleted, for processes that still hold its signature."""

    __tablename__ = "removals"

    shape_number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    revision: Mapped[int] = mapped_column(index=True)


class DeletedRow(Table):
    """A deleted shape, which can be restored.

    It has the bytes once more, so that nothing else need know of it: the blob and the embeddings go with the
    last shape that has them, and a restored shape is stored anew. `number` orders them by when they were
    deleted.
    """

    __tablename__ = "deleted_shapes"
    __table_args__ = (
        Index("deleted_shapes_by_collection", "collection_number", "number"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36), unique=True)
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number"))
    name: Mapped[str] = mapped_column(String(255))
    tags: Mapped[list[str]] = mapped_column(JSON)
    meta: Mapped[dict[str, Any]] = mapped_column(JSON)
    format: Mapped[str] = mapped_column(String(8))
    sha256: Mapped[str] = mapped_column(String(64))
    size: Mapped[int]
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    deleted_at: Mapped[datetime] = mapped_column(UtcDateTime, index=True)
    data: Mapped[bytes] = mapped_column(LargeBinary, deferred=True)


class PipelineRow(Table):
    """A pipeline that made embeddings: the version of the method, and its parameters."""

    __tablename__ = "pipelines"

    fingerprint: Mapped[str] = mapped_column(String(16), primary_key=True)
    method: Mapped[int]
    parameters: Mapped[dict[str, Any]] = mapped_column(JSON)


class IdempotencyKeyRow(Table):
    """The answer to a request that had an Idempotency-Key, for the next one that has it.

    `scope` is the digest of the API key that sent it, or empty; `payload` is a hash of what was sent.
    """

    __tablename__ = "idempotency_keys"

    collection_number: Mapped[int] = mapped_column(
        ForeignKey("collections.number", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    scope: Mapped[str] = mapped_column(String(64), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    payload: Mapped[str] = mapped_column(String(64))
    status: Mapped[int]
    location: Mapped[str] = mapped_column(String(255))
    body: Mapped[str] = mapped_column(Text)
    expires_at: Mapped[datetime] = mapped_column(UtcDateTime, index=True)


class ArchiveRow(Table):
    """The one row about the archive itself.

    `revision` is how many times what is searched has changed; `fingerprint` that of the pipeline it is
    searched by, none before the first start.
    """

    __tablename__ = "archive"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    revision: Mapped[int]
    fingerprint: Mapped[str | None] = mapped_column(String(16))


class ThumbnailRow(Table):
    """A picture of a blob read in one format, `size` pixels a side; `drawing` tells how it was drawn."""

    __tablename__ = "thumbnails"

    blob_number: Mapped[int] = mapped_column(ForeignKey("blobs.number", ondelete="CASCADE"), primary_key=True)
    format: Mapped[str] = mapped_column(String(8), primary_key=True)
    size: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    drawing: Mapped[int]
    data: Mapped[bytes] = mapped_column(LargeBinary)
