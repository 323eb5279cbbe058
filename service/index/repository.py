"""The SQL of the signature index, and its entries."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row, func, select

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
    def arrays(self) -> list[NDArray[Any]]:
        """The arrays, in the order of the fields."""
        return [getattr(self, field.name) for field in fields(self)]

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, in bytes."""
        return sum(array.nbytes for array in self.arrays)

    def without_samples(self) -> "IndexEntries":
        """Return the entries without their coarse samples and view signatures, which shortlists need."""
        nothing = np.empty((len(self.shapes), 0), np.uint8)
        return replace(self, coarse_samples=nothing, view_signatures=nothing)

    def only(self, rows: NDArray[np.integer] | NDArray[np.bool_] | slice) -> "IndexEntries":
        """Return the entries at some indices, or those that a mask selects, as copies; or a slice of them."""
        return IndexEntries(*(array[rows] for array in self.arrays))


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

OF_SHAPE = (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format)
"""The condition that an embedding is of a shape's file."""

ENTRIES = (
    select(
        ShapeRow.number,
        ShapeRow.collection_number,
        EmbeddingRow.number,
        CoarseSamplesRow.signature,
        CoarseSamplesRow.data,
        CoarseSamplesRow.view_signature,
        CoarseSamplesRow.reliability,
    )
    .join(EmbeddingRow, OF_SHAPE)
    .join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number)
    .where(NOT_DELETED)
)
"""A query of the rows of the entries of all pipelines."""


def has_embedding(session: ReadSession, shape: int, embedding: int) -> bool:
    """Return whether a shape exists and has an embedding, both given by number."""
    wanted = ShapeRow.number == shape, EmbeddingRow.number == embedding
    return session.scalar(ENTRIES.with_only_columns(ShapeRow.number).where(*wanted)) is not None


def entries_since(session: ReadSession, fingerprint: str, since: int) -> Iterator[IndexEntries]:
    """Yield the embedded shapes of a pipeline that were stored, or embedded, after a revision.

    The entries come in batches, so that the rows of a large archive are never in memory at once. The query
    runs on the connection, because the session's own methods take twice as long.
    """
    query = ENTRIES.where(ShapeRow.revision > since, EmbeddingRow.fingerprint == fingerprint)
    with session.connection().execute(query.execution_options(yield_per=AT_ONCE)) as rows:
        yield from map(entries_of, rows.partitions())


def entries_of(rows: Sequence[Row[*tuple[Any, ...]]]) -> IndexEntries:
    """Return the entries of rows of `ENTRIES`."""
    if not rows:
        return NOTHING
    shapes, collections, embeddings, *bytes_of_rows, view_signatures, reliabilities = zip(*rows, strict=True)
    signatures, coarse_samples = map(stacked, bytes_of_rows)
    return IndexEntries(
        np.array(shapes, dtype=np.int64),
        np.array(collections, dtype=np.int64),
        np.array(embeddings, dtype=np.int64),
        signatures.view("<f4"),
        coarse_samples,
        stacked([b"" if row is None else row.tobytes() for row in view_signatures]),
        np.array(reliabilities, dtype=np.float32),
    )


def stacked(rows: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return byte strings of equal length as an array, shape (n, l), uint8; an empty string becomes zeros."""
    length = max(map(len, rows), default=0)
    data = b"".join(row or bytes(length) for row in rows)
    return np.frombuffer(data, dtype=np.uint8).reshape(len(rows), length)


def removed_since(session: ReadSession, since: int) -> NDArray[np.int64]:
    """Return the numbers of the shapes deleted after a revision."""
    query = select(RemovalRow.shape_number).where(RemovalRow.revision > since)
    return np.array(session.scalars(query).all(), dtype=np.int64)


def facts_since(session: ReadSession, since: int) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the facts of the shapes that were stored, or embedded, after a revision, by number."""
    query = select(ShapeRow.number, ShapeRow.facts).where(ShapeRow.revision > since, NOT_DELETED)
    with session.connection().execute(query.execution_options(yield_per=AT_ONCE)) as rows:
        yield from ((number, facts) for number, facts in rows)
