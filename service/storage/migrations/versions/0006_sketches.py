"""Coarse samples, for a rough match that does not read records.

The code that makes them is frozen here: a later version of `core` may make other ones.
"""

import json

import numpy as np
import sqlalchemy as sa
from alembic import op
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load

from service.storage.columns import Number

revision = "0006"
down_revision = "0005"

AT_ONCE = 500
SAMPLES = 32


def upgrade() -> None:
    """Make their table, and the sketches of stored shapes; a record that cannot be read has none."""
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
                data = _coarse_samples(record)
            except (SafetensorError, KeyError, OverflowError, RecursionError, TypeError, ValueError):
                continue
            made.append({"embedding_number": number, "data": data})
        if made:
            connection.execute(sa.insert(sketches), made)
        last = batch[-1][0]


def _coarse_samples(record: bytes) -> bytes:
    """The first samples of a record: their number, a float32 scale a column, and int8 coordinates.

    Raises
    ------
    SafetensorError, KeyError, OverflowError, RecursionError, TypeError, ValueError
        The record cannot be read.
    """
    arrays = load(record)
    spectra = json.loads(arrays["header"].tobytes())["spectra"]
    clouds: list[NDArray[np.float32]] = [arrays[f"coordinates_{place}"] for place in range(len(spectra))]
    count = min(int(arrays["regions"].max()) + 1, SAMPLES)
    points = np.concatenate([cloud[:count] for cloud in clouds], axis=1)
    scales = (np.abs(points).max(axis=0) / np.float32(127.0)).astype(np.float32)
    whole = np.zeros((SAMPLES, points.shape[1]), dtype=np.int8)
    whole[:count] = np.rint(np.divide(points, scales, out=np.zeros_like(points), where=scales > 0.0))
    return b"".join(array.tobytes() for array in (np.array([count], dtype=np.int32), scales, whole))
