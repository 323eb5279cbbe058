"""Bytes, for a rough match that does not read records."""

import sqlalchemy as sa
from alembic import op

from core.errors import BadRecordError
from core.ranking.coarse_ranking import sketch_of
from core.serialization import embedding_from_bytes
from service.storage.columns import Number

revision = "0006"
down_revision = "0005"

AT_ONCE = 500


def upgrade() -> None:
    """Make their table, and the sketches of what is stored; a record that cannot be read has none."""
    sketches = op.create_table(
        "sketches",
        sa.Column("embedding_number", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["embedding_number"], ["embeddings.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("embedding_number"),
    )
    connection = op.get_bind()
    records = sa.text(
        "SELECT number, record FROM embeddings WHERE number > :last ORDER BY number LIMIT :most"
    )
    last = 0
    while batch := connection.execute(records, {"last": last, "most": AT_ONCE}).all():
        made = []
        for number, record in batch:
            try:
                sketch = sketch_of(embedding_from_bytes(record))
            except BadRecordError:
                continue
            made.append({"embedding_number": number, "data": sketch.tobytes()})
        if made:
            connection.execute(sa.insert(sketches), made)
        last = batch[-1][0]
