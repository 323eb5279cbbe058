"""The first tables."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number, PgVector

revision = "0001"
down_revision = None

Signature = sa.LargeBinary().with_variant(PgVector(), "postgresql")


def upgrade() -> None:
    """Make the tables, and the one row about the archive."""
    on_postgresql = op.get_bind().dialect.name == "postgresql"
    if on_postgresql:
        op.execute("CREATE EXTENSION IF NOT EXISTS vector")
    op.create_table(
        "blobs",
        sa.Column("number", Number, nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("size", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("sha256"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "shapes",
        sa.Column("number", Number, nullable=False),
        sa.Column("id", sa.String(36), nullable=False),
        sa.Column("blob_number", Number, nullable=False),
        sa.Column("format", sa.String(8), nullable=False),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("folded_name", sa.String(1024), nullable=False),
        sa.Column("meta", sa.JSON(), nullable=False),
        sa.Column("facts", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("updated_at", sa.DateTime(), nullable=False),
        sa.Column("revision", Number, nullable=False),
        sa.ForeignKeyConstraint(["blob_number"], ["blobs.number"]),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("id"),
        sa.UniqueConstraint("blob_number", "format", "name", name="one_shape_a_name"),
        sqlite_autoincrement=True,
    )
    op.create_index("shapes_by_revision", "shapes", ["revision"])
    op.create_index("shapes_by_folded_name", "shapes", ["folded_name"])
    op.create_table(
        "shape_tags",
        sa.Column("shape_number", Number, nullable=False),
        sa.Column("tag", sa.String(64), nullable=False),
        sa.Column("place", Number, nullable=False),
        sa.ForeignKeyConstraint(["shape_number"], ["shapes.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("shape_number", "tag"),
    )
    op.create_index("shapes_by_tag", "shape_tags", ["tag", "shape_number"])
    op.create_table(
        "shape_metadata",
        sa.Column("shape_number", Number, nullable=False),
        sa.Column("key", sa.String(), nullable=False),
        sa.Column("value", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(["shape_number"], ["shapes.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("shape_number", "key"),
    )
    if on_postgresql:
        op.create_index("shapes_by_metadata_value", "shape_metadata", ["value"], postgresql_using="hash")
    else:
        op.create_index("shapes_by_metadata", "shape_metadata", ["key", "value", "shape_number"])
    op.create_table(
        "embeddings",
        sa.Column("number", Number, nullable=False),
        sa.Column("blob_number", Number, nullable=False),
        sa.Column("format", sa.String(8), nullable=False),
        sa.Column("fingerprint", sa.String(16), nullable=False),
        sa.Column("signature", Signature, nullable=False),
        sa.Column("record", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["blob_number"], ["blobs.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("blob_number", "format", "fingerprint", name="one_embedding_a_pipeline"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "removals",
        sa.Column("shape_number", Number, nullable=False),
        sa.Column("revision", Number, nullable=False),
        sa.PrimaryKeyConstraint("shape_number"),
    )
    op.create_index("ix_removals_revision", "removals", ["revision"])
    archive = op.create_table(
        "archive",
        sa.Column("number", Number, nullable=False),
        sa.Column("revision", Number, nullable=False),
        sa.PrimaryKeyConstraint("number"),
    )
    op.bulk_insert(archive, [{"number": 1, "revision": 0}])
