"""The SQL of the signature index, and its entries."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select

from service.storage.database import ReadSession
from service.storage.tables import (
    NOT_DELETED,
    ArchiveRow,
    CoarseSamplesRow,
    EmbeddingRow,
    RemovalRow,
    ShapeRow,
)

AT_ONCE = 20_000


@dataclass(frozen=True, eq=False)
class IndexEntries:
    """Shapes of the signature index.

    Attributes
    ----------
    shapes : int64, shape (n,)
        Numbers of the shapes.
    collections : int64, shape (n,)
        Numbers of their collections.
    embeddings : int64, shape (n,)
        Numbers of their embeddings.
    signatures : float32, shape (n, s)
    coarse_samples : uint8, shape (n, l)
        See `core.ranking.reranking`; zeros for embeddings without coarse samples.
    view_signatures : uint8, shape (n, v)
        See `core.descriptors.views`; v is 0 for a pipeline without views.
    reliabilities : float32, shape (n,)
        See `core.descriptors.facts`; NaN without views.
    """

    shapes: NDArray[np.int64]
    collections: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]
    coarse_samples: NDArray[np.uint8]
    view_signatures: NDArray[np.uint8]
    reliabilities: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, in bytes."""
        return sum(getattr(self, part.name).nbytes for part in fields(self))

    def only(self, places: NDArray[np.integer] | NDArray[np.bool_]) -> "IndexEntries":
        """Return a copy of the entries at some indices, or of those that a mask selects."""
        return IndexEntries(*(getattr(self, part.name)[places] for part in fields(self)))


def revision(session: ReadSession) -> int:
    """Return the revision of the archive, which counts changes of searchable data."""
    return session.scalars(select(ArchiveRow.revision)).one()


def count_shapes(session: ReadSession) -> int:
    """Return the number of shapes in all collections."""
    return session.scalars(select(func.count()).where(NOT_DELETED)).one()


NOTHING = IndexEntries(
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty((0, 0), np.float32),
    np.empty((0, 0), np.uint8),
    np.empty((0, 0), np.uint8),
    np.empty(0, np.float32),
)


def entries_since(session: ReadSession, fingerprint: str, since: int) -> Iterator[IndexEntries]:
    """Yield the embedded shapes of a pipeline that were stored, or embedded, after a revision.

    The entries come in batches, so that the rows of a large archive are never in memory at once. The query
    runs on the connection, because the session's own methods take twice as long.
    """
    query = (
        select(
            ShapeRow.number,
            ShapeRow.collection_number,
            EmbeddingRow.number,
            CoarseSamplesRow.signature,
            CoarseSamplesRow.data,
            CoarseSamplesRow.view_signature,
            CoarseSamplesRow.reliability,
        )
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number)
        .where(ShapeRow.revision > since, NOT_DELETED, EmbeddingRow.fingerprint == fingerprint)
        .execution_options(yield_per=AT_ONCE)
    )
    with session.connection().execute(query) as found:
        for rows in found.partitions():
            shapes, collections, embeddings, *sketches = zip(*rows, strict=True)
            signatures, coarse_samples, view_signatures, reliabilities = sketches
            yield IndexEntries(
                np.array(shapes, dtype=np.int64),
                np.array(collections, dtype=np.int64),
                np.array(embeddings, dtype=np.int64),
                stacked(signatures).view("<f4"),
                stacked(coarse_samples),
                stacked_views(view_signatures),
                np.array(reliabilities, dtype=np.float32),
            )


def stacked(rows: Sequence[bytes]) -> NDArray[np.uint8]:
    """Byte strings of equal length as an array, shape (n, l), uint8; an empty string becomes zeros."""
    length = max(map(len, rows), default=0)
    data = b"".join(one or bytes(length) for one in rows)
    return np.frombuffer(data, dtype=np.uint8).reshape(len(rows), length)


def stacked_views(rows: Sequence[NDArray[np.uint8] | None]) -> NDArray[np.uint8]:
    """View signatures as an array, shape (n, v), uint8; v is 0 if the embeddings have no views."""
    return stacked([b"" if one is None else one.tobytes() for one in rows])


def removed_since(session: ReadSession, since: int) -> NDArray[np.int64]:
    """Return the numbers of the shapes deleted after a revision."""
    query = select(RemovalRow.shape_number).where(RemovalRow.revision > since)
    return np.array(session.scalars(query).all(), dtype=np.int64)


def facts_since(session: ReadSession, since: int) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the facts of the shapes that were stored, or embedded, after a revision, by number."""
    query = select(ShapeRow.number, ShapeRow.facts).where(ShapeRow.revision > since, NOT_DELETED)
    with session.connection().execute(query.execution_options(yield_per=AT_ONCE)) as found:
        yield from ((number, facts) for number, facts in found)
