"""Pairs of near-identical shapes, and the shapes that are judged."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Create their tables. The service judges the shapes that are there."""
    op.create_table(
        "duplicate_pairs",
        sa.Column("first_number", Number, nullable=False),
        sa.Column("second_number", Number, nullable=False),
        sa.Column("fingerprint", sa.String(16), nullable=False),
        sa.Column("cc", sa.Double(), nullable=False),
        sa.Column("residual", sa.Double(), nullable=False),
        sa.Column("scale", sa.Double(), nullable=False),
        sa.Column("mirrored", sa.Boolean(), nullable=False),
        sa.Column("variant", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("first_number", "second_number", "fingerprint"),
        sa.ForeignKeyConstraint(["first_number"], ["shapes.number"], ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["second_number"], ["shapes.number"], ondelete="CASCADE"),
    )
    op.create_index("duplicate_pairs_by_second", "duplicate_pairs", ["second_number"])
    op.create_table(
        "judged_shapes",
        sa.Column("number", Number, nullable=False),
        sa.Column("shape_number", Number, nullable=False),
        sa.Column("fingerprint", sa.String(16), nullable=False),
        sa.Column("variants", sa.Boolean(), nullable=False),
        sa.Column("min_cc", sa.Double(), nullable=False),
        sa.Column("max_residual", sa.Double(), nullable=False),
        sa.Column("compared", Number, nullable=False),
        sa.Column("aligned", Number, nullable=False),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("shape_number", "fingerprint", "variants", name="one_judgement_a_search"),
        sa.ForeignKeyConstraint(["shape_number"], ["shapes.number"], ondelete="CASCADE"),
        sqlite_autoincrement=True,
    )
