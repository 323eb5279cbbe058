"""The SQL of what is kept in memory of stored shapes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select

from service.storage.database import ReadSession
from service.storage.tables import ArchiveRow, EmbeddingRow, RemovalRow, ShapeRow, SketchRow

AT_ONCE = 20_000


@dataclass(frozen=True, eq=False)
class IndexEntries:
    """Shapes and their signatures.

    Attributes
    ----------
    shapes : int64, shape (n,)
        Their numbers.
    collections : int64, shape (n,)
        The number of each shape's collection.
    embeddings : int64, shape (n,)
        The number of each shape's embedding.
    signatures : float32, shape (n, s)
    sketches : uint8, shape (n, l)
        All zero where an embedding has none.
    """

    shapes: NDArray[np.int64]
    collections: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]
    coarse_samples: NDArray[np.uint8]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(getattr(self, part.name).nbytes for part in fields(self))

    def only(self, places: NDArray[np.integer] | NDArray[np.bool_]) -> "IndexEntries":
        """Those at some places, in new memory."""
        return IndexEntries(*(getattr(self, part.name)[places] for part in fields(self)))


def revision(session: ReadSession) -> int:
    """How many times what is searched has changed."""
    return session.scalars(select(ArchiveRow.revision)).one()


def shapes_stored(session: ReadSession) -> int:
    """How many shapes there are."""
    return session.scalars(select(func.count()).select_from(ShapeRow)).one()


NOTHING = IndexEntries(
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty((0, 0), np.float32),
    np.empty((0, 0), np.uint8),
)


def entries_since(session: ReadSession, fingerprint: str, since: int) -> Iterator[IndexEntries]:
    """The shapes that came, or were embedded, after a revision, as far as one pipeline embedded them.

    In batches, so that the rows of a large archive are not all there at once; by the connection, whose rows
    take half as long as the session's.
    """
    query = (
        select(
            ShapeRow.number,
            ShapeRow.collection_number,
            EmbeddingRow.number,
            SketchRow.signature,
            SketchRow.data,
        )
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .join(SketchRow, SketchRow.embedding_number == EmbeddingRow.number)
        .where(ShapeRow.revision > since, EmbeddingRow.fingerprint == fingerprint)
        .execution_options(yield_per=AT_ONCE)
    )
    with session.connection().execute(query) as found:
        for rows in found.partitions():
            shapes, collections, embeddings, signatures, coarse_samples = zip(*rows, strict=True)
            yield IndexEntries(
                np.array(shapes, dtype=np.int64),
                np.array(collections, dtype=np.int64),
                np.array(embeddings, dtype=np.int64),
                stacked(signatures).view("<f4"),
                stacked(coarse_samples),
            )


def stacked(rows: Sequence[bytes]) -> NDArray[np.uint8]:
    """Bytes as rows of an array, all of one length; all zero where there are none."""
    length = max(map(len, rows), default=0)
    data = b"".join(one or bytes(length) for one in rows)
    return np.frombuffer(data, dtype=np.uint8).reshape(len(rows), length)


def removed_since(session: ReadSession, since: int) -> NDArray[np.int64]:
    """The numbers of the shapes deleted after a revision."""
    query = select(RemovalRow.shape_number).where(RemovalRow.revision > since)
    return np.array(session.scalars(query).all(), dtype=np.int64)
