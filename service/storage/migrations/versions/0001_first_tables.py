"""The tables of `service.storage.tables`, the row about the archive, and the default collection."""

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from alembic import op

from service.storage.columns import POSTGRESQL, AnyText, Number, PgVector, UtcDateTime

revision = "0001"
down_revision = None

Vector = sa.LargeBinary().with_variant(PgVector(), POSTGRESQL)
Checksum = sa.String(32)


def upgrade() -> None:
    """Create the tables, and insert the rows that every archive has."""
    if op.get_bind().dialect.name == POSTGRESQL:
        op.execute("CREATE EXTENSION IF NOT EXISTS vector")
    _create_archive()
    _create_shapes()
    _create_embeddings()
    _create_duplicates()
    _create_jobs()


def _create_archive() -> None:
    """Create the tables of the archive, its pipelines, collections and idempotency keys."""
    archive = op.create_table(
        "archive",
        _column("number", Number),
        _column("revision", Number),
        _column("fingerprint", sa.String(16), nullable=True),
        sa.PrimaryKeyConstraint("number"),
    )
    op.bulk_insert(archive, [{"number": 1, "revision": 0}])
    op.create_table(
        "pipelines",
        _column("fingerprint", sa.String(16)),
        _column("method", Number),
        _column("parameters", sa.JSON()),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("fingerprint"),
    )
    collections = op.create_table(
        "collections",
        _column("number", Number),
        _column("name", sa.String(64)),
        _column("created_at", UtcDateTime()),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("name"),
        sqlite_autoincrement=True,
    )
    # The database generates the number, so that it never gives the number again.
    op.execute(sa.insert(collections).values(name="default", created_at=datetime.now(UTC)))
    op.create_table(
        "idempotency_keys",
        _column("collection_number", Number, autoincrement=False),
        _column("scope", sa.String(64)),
        _column("key", sa.String(255)),
        _column("payload", sa.String(64)),
        _column("status", Number),
        _column("location", sa.String(255)),
        _column("body", sa.Text()),
        _column("expires_at", UtcDateTime()),
        sa.PrimaryKeyConstraint("collection_number", "scope", "key"),
        _reference("collection_number", "collections"),
    )
    op.create_index("ix_idempotency_keys_expires_at", "idempotency_keys", ["expires_at"])


def _create_shapes() -> None:
    """Create the tables of files, shapes, tags, metadata, deletions and thumbnails."""
    op.create_table(
        "blobs",
        _column("number", Number),
        _column("sha256", sa.String(64)),
        _column("size", Number),
        _column("data", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("sha256"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "shapes",
        _column("number", Number),
        _column("id", AnyText(36)),
        _column("collection_number", Number),
        _column("blob_number", Number),
        _column("format", sa.String(8)),
        _column("name", sa.String(255)),
        _column("folded_name", sa.String(1024)),
        _column("meta", sa.JSON()),
        _column("facts", sa.JSON()),
        _column("created_at", UtcDateTime()),
        _column("updated_at", UtcDateTime()),
        _column("deleted_at", UtcDateTime(), nullable=True),
        _column("revision", Number),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("id"),
        sa.ForeignKeyConstraint(["collection_number"], ["collections.number"]),
        sa.ForeignKeyConstraint(["blob_number"], ["blobs.number"]),
        sqlite_autoincrement=True,
    )
    where: dict[str, Any] = {
        f"{dialect}_where": sa.text("deleted_at IS NULL") for dialect in ("sqlite", POSTGRESQL)
    }
    named = ["blob_number", "format", "name", "collection_number"]
    op.create_index("one_shape_a_name", "shapes", named, unique=True, **where)
    op.create_index("shapes_by_blob", "shapes", ["blob_number", "format"])
    op.create_index("shapes_by_revision", "shapes", ["revision"])
    op.create_index("shapes_by_collection", "shapes", ["collection_number", "number"], **where)
    op.create_index("shapes_by_deletion", "shapes", ["deleted_at"])
    op.create_index("shapes_by_folded_name", "shapes", ["collection_number", "folded_name"])
    op.create_table(
        "shape_tags",
        _column("shape_number", Number),
        _column("tag", sa.String(64)),
        _column("position", Number),
        sa.PrimaryKeyConstraint("shape_number", "tag"),
        _reference("shape_number", "shapes"),
    )
    op.create_index("shapes_by_tag", "shape_tags", ["tag", "shape_number"])
    op.create_table(
        "shape_metadata",
        _column("shape_number", Number),
        _column("key", AnyText()),
        _column("value", AnyText()),
        sa.PrimaryKeyConstraint("shape_number", "key"),
        _reference("shape_number", "shapes"),
    )
    if op.get_bind().dialect.name == POSTGRESQL:
        op.create_index("shapes_by_metadata_value", "shape_metadata", ["value"], postgresql_using="hash")
    else:
        op.create_index("shapes_by_metadata", "shape_metadata", ["key", "value", "shape_number"])
    op.create_table(
        "removals",
        _column("shape_number", Number, autoincrement=False),
        _column("revision", Number),
        sa.PrimaryKeyConstraint("shape_number"),
    )
    op.create_index("ix_removals_revision", "removals", ["revision"])
    op.create_table(
        "thumbnails",
        _column("blob_number", Number),
        _column("format", sa.String(8)),
        _column("size", Number),
        _column("drawing", Number),
        _column("data", sa.LargeBinary()),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("blob_number", "format", "size"),
        _reference("blob_number", "blobs"),
    )


def _create_embeddings() -> None:
    """Create the tables of embeddings, and of the descriptors that a search reads of many."""
    op.create_table(
        "embeddings",
        _column("number", Number),
        _column("blob_number", Number),
        _column("format", sa.String(8)),
        _column("fingerprint", sa.String(16)),
        _column("signature", Vector),
        _column("record", sa.LargeBinary()),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("blob_number", "format", "fingerprint", name="one_embedding_a_pipeline"),
        _reference("blob_number", "blobs"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "coarse_samples",
        _column("embedding_number", Number, autoincrement=False),
        _column("data", sa.LargeBinary()),
        _column("signature", sa.LargeBinary()),
        _column("view_signature", Vector),
        _column("reliability", sa.Double()),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("embedding_number"),
        _reference("embedding_number", "embeddings"),
    )
    op.create_table(
        "quantised_points",
        _column("embedding_number", Number, autoincrement=False),
        _column("data", sa.LargeBinary()),
        _column("checksum", Checksum),
        sa.PrimaryKeyConstraint("embedding_number"),
        _reference("embedding_number", "embeddings"),
    )


def _create_duplicates() -> None:
    """Create the tables of near-identical pairs and of judged shapes."""
    op.create_table(
        "duplicate_pairs",
        _column("first_number", Number, autoincrement=False),
        _column("second_number", Number, autoincrement=False),
        _column("fingerprint", sa.String(16)),
        _column("cc", sa.Double()),
        _column("residual", sa.Double()),
        _column("scale", sa.Double()),
        _column("mirrored", sa.Boolean()),
        _column("variant", sa.Boolean()),
        sa.PrimaryKeyConstraint("first_number", "second_number", "fingerprint"),
        _reference("first_number", "shapes"),
        _reference("second_number", "shapes"),
    )
    op.create_index("duplicate_pairs_by_second", "duplicate_pairs", ["second_number"])
    op.create_table(
        "judged_shapes",
        _column("number", Number),
        _column("shape_number", Number),
        _column("fingerprint", sa.String(16)),
        _column("variants", sa.Boolean()),
        _column("min_cc", sa.Double()),
        _column("max_residual", sa.Double()),
        _column("compared", Number),
        _column("aligned", Number),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("shape_number", "fingerprint", "variants", name="one_judgement_a_search"),
        _reference("shape_number", "shapes"),
        sqlite_autoincrement=True,
    )


def _create_jobs() -> None:
    """Create the tables of bulk jobs and of the files in their archives."""
    op.create_table(
        "jobs",
        _column("number", Number),
        _column("id", AnyText(36)),
        _column("collection_number", Number),
        _column("state", sa.String(16)),
        _column("archive", sa.String(255)),
        _column("size", Number),
        _column("tags", sa.JSON()),
        _column("meta", sa.JSON()),
        _column("kind", sa.String(64), nullable=True),
        _column("detail", sa.Text(), nullable=True),
        _column("runner", sa.String(36), nullable=True),
        _column("leased_until", UtcDateTime(), nullable=True),
        _column("created_at", UtcDateTime()),
        _column("started_at", UtcDateTime(), nullable=True),
        _column("ended_at", UtcDateTime(), nullable=True),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("id"),
        sa.ForeignKeyConstraint(["collection_number"], ["collections.number"]),
        sqlite_autoincrement=True,
    )
    op.create_index("jobs_by_state", "jobs", ["state"])
    op.create_index("jobs_by_collection", "jobs", ["collection_number", "number"])
    op.create_table(
        "job_files",
        _column("job_number", Number),
        _column("position", Number),
        _column("path", sa.String(1024)),
        _column("name", sa.String(1024)),
        _column("outcome", sa.String(16), nullable=True),
        _column("shape_id", sa.String(36), nullable=True),
        _column("kind", sa.String(64), nullable=True),
        _column("detail", sa.Text(), nullable=True),
        _column("ended_at", UtcDateTime(), nullable=True),
        sa.PrimaryKeyConstraint("job_number", "position"),
        _reference("job_number", "jobs"),
    )
    op.create_index("job_files_by_outcome", "job_files", ["job_number", "outcome", "position"])


def _column(name: str, kind: Any, *, nullable: bool = False, autoincrement: Any = "auto") -> Any:  # noqa: ANN401
    return sa.Column(name, kind, nullable=nullable, autoincrement=autoincrement)


def _reference(column: str, table: str) -> sa.ForeignKeyConstraint:
    """Return a reference whose row is deleted with the row that it refers to."""
    return sa.ForeignKeyConstraint([column], [f"{table}.number"], ondelete="CASCADE")
