"""View signatures and reliabilities, beside the sketches of embeddings that have views."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import PgVector

revision = "0011"
down_revision = "0010"

ViewSignature = sa.LargeBinary().with_variant(PgVector(), "postgresql")


def upgrade() -> None:
    """Add their columns. The embeddings that are there were made without views."""
    op.add_column("sketches", sa.Column("view_signature", ViewSignature))
    op.add_column("sketches", sa.Column("reliability", sa.Double()))
