"""The pipeline that the archive is searched by, with its parameters.

Archives of 0.1.0 tell of a pipeline by its fingerprint only. The one by which most of their embeddings were
made is the one in use.
"""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add a table, and a column to the row about the archive."""
    op.create_table(
        "pipelines",
        sa.Column("fingerprint", sa.String(16), nullable=False),
        sa.Column("method", Number, nullable=False),
        sa.Column("parameters", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("fingerprint"),
    )
    op.add_column("archive", sa.Column("fingerprint", sa.String(16), nullable=True))
    op.execute(
        "UPDATE archive SET fingerprint = (SELECT fingerprint FROM embeddings "
        "GROUP BY fingerprint ORDER BY count(*) DESC, max(number) DESC LIMIT 1)"
    )
