"""Quantised points, for re-ranking that does not read records.

The code that makes them is frozen here: a later version of `core` may make other ones.
"""

import json
from hashlib import blake2b

import numpy as np
import sqlalchemy as sa
from alembic import op
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load

from service.storage.columns import Number

revision = "0013"
down_revision = "0012"

AT_ONCE = 500


def upgrade() -> None:
    """Make their table, and the points of stored embeddings; a damaged record has none."""
    points = op.create_table(
        "points",
        sa.Column("embedding_number", Number, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.Column("checksum", sa.String(32), nullable=False),
        sa.ForeignKeyConstraint(["embedding_number"], ["embeddings.number"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("embedding_number"),
    )
    connection = op.get_bind()
    records = sa.text(
        "SELECT number, record, checksum FROM embeddings WHERE number > :last ORDER BY number LIMIT :most"
    )
    last = 0
    while batch := connection.execute(records, {"last": last, "most": AT_ONCE}).all():
        made = []
        for number, record, checksum in batch:
            if checksum not in {None, _checksum(record)}:
                continue
            try:
                data = _points(record)
            except (SafetensorError, KeyError, OverflowError, RecursionError, TypeError, ValueError):
                continue
            made.append({"embedding_number": number, "data": data, "checksum": _checksum(data)})
        if made:
            connection.execute(sa.insert(points), made)
        last = batch[-1][0]


def _checksum(data: bytes) -> str:
    return blake2b(data, digest_size=16).hexdigest()


def _points(record: bytes) -> bytes:
    """The points of a record: their numbers, a float32 scale a column, regions, and int8 coordinates.

    Raises
    ------
    SafetensorError, KeyError, OverflowError, RecursionError, TypeError, ValueError
        The record cannot be read.
    """
    arrays = load(record)
    spectra = json.loads(arrays["header"].tobytes())["spectra"]
    clouds: list[NDArray[np.float32]] = [arrays[f"coordinates_{place}"] for place in range(len(spectra))]
    points = np.concatenate(clouds, axis=1)
    scales = (np.abs(points).max(axis=0) / np.float32(127.0)).astype(np.float32)
    whole = np.rint(np.divide(points, scales, out=np.zeros_like(points), where=scales > 0.0)).astype(np.int8)
    head = np.array(points.shape, dtype=np.int32)
    data = b"".join(array.tobytes() for array in (head, scales, arrays["regions"], whole))
    return data + bytes(-len(data) % 4)
