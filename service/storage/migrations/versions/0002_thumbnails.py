"""Thumbnails."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Make their table."""
    op.create_table(
        "thumbnails",
        sa.Column("blob_number", Number, nullable=False),
        sa.Column("format", sa.String(8), nullable=False),
        sa.Column("size", Number, nullable=False),
        sa.Column("drawing", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["blob_number"], ["blobs.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("blob_number", "format", "size"),
    )
