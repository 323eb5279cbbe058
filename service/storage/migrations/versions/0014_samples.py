"""Quantised samples in place of all quantised points: re-ranking reads the samples alone."""

from hashlib import blake2b

import numpy as np
import sqlalchemy as sa
from alembic import op

from service.storage.columns import Number

revision = "0014"
down_revision = "0013"

AT_ONCE = 5000


def upgrade() -> None:
    """Make their table from the points, which go; damaged points give no samples."""
    samples = op.create_table(
        "samples",
        sa.Column("embedding_number", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.Column("checksum", sa.String(32), nullable=False),
        sa.ForeignKeyConstraint(["embedding_number"], ["embeddings.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("embedding_number"),
    )
    connection = op.get_bind()
    points = sa.text(
        "SELECT embedding_number, data, checksum FROM points "
        "WHERE embedding_number > :last ORDER BY embedding_number LIMIT :most"
    )
    last = 0
    while batch := connection.execute(points, {"last": last, "most": AT_ONCE}).all():
        made = []
        for number, data, checksum in batch:
            if checksum == _checksum(data):
                few = _samples(data)
                made.append({"embedding_number": number, "data": few, "checksum": _checksum(few)})
        if made:
            connection.execute(sa.insert(samples), made)
        last = batch[-1][0]
    op.drop_table("points")


def _checksum(data: bytes) -> str:
    return blake2b(data, digest_size=16).hexdigest()


def _samples(points: bytes) -> bytes:
    """The samples, which come first, of points: their number, a scale a column, int8 coordinates.

    Points have the numbers of points and of columns, int32, a float32 scale a column, the sample nearest to
    each point, int32, and int8 coordinates.
    """
    count, columns = np.frombuffer(points, dtype=np.int32, count=2).tolist()
    start = 8 + 4 * columns
    few = int(np.frombuffer(points, dtype=np.int32, count=count, offset=start).max()) + 1
    whole = points[start + 4 * count :][: few * columns]
    data = np.int32(few).tobytes() + points[8:start] + whole
    return data + bytes(-len(data) % 4)
