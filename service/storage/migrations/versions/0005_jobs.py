"""Bulk jobs."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Make their tables."""
    op.create_table(
        "jobs",
        sa.Column("number", Number, nullable=False),
        sa.Column("id", sa.String(36), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("archive", sa.String(255), nullable=False),
        sa.Column("format", sa.String(8), nullable=False),
        sa.Column("size", Number, nullable=False),
        sa.Column("tags", sa.JSON(), nullable=False),
        sa.Column("meta", sa.JSON(), nullable=False),
        sa.Column("kind", sa.String(64)),
        sa.Column("detail", sa.Text()),
        sa.Column("runner", sa.String(36)),
        sa.Column("leased_until", sa.DateTime()),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("started_at", sa.DateTime()),
        sa.Column("ended_at", sa.DateTime()),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("id"),
        sqlite_autoincrement=True,
    )
    op.create_index("jobs_by_state", "jobs", ["state"])
    op.create_table(
        "job_pieces",
        sa.Column("job_number", Number, nullable=False),
        sa.Column("place", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["job_number"], ["jobs.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_number", "place"),
    )
    op.create_table(
        "job_files",
        sa.Column("job_number", Number, nullable=False),
        sa.Column("place", Number, nullable=False),
        sa.Column("path", sa.String(1024), nullable=False),
        sa.Column("name", sa.String(1024), nullable=False),
        sa.Column("outcome", sa.String(16)),
        sa.Column("shape_id", sa.String(36)),
        sa.Column("kind", sa.String(64)),
        sa.Column("detail", sa.Text()),
        sa.Column("ended_at", sa.DateTime()),
        sa.ForeignKeyConstraint(["job_number"], ["jobs.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_number", "place"),
    )
    op.create_index("job_files_by_outcome", "job_files", ["job_number", "outcome", "place"])
