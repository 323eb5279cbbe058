"""The SQL of search: records and points by embedding, and nearest signatures in PostgreSQL with pgvector.

PostgreSQL finds neighbours by exact search, or by an HNSW index (`service.storage.hnsw`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    Float,
    Select,
    SQLColumnExpression,
    String,
    bindparam,
    cast,
    func,
    literal,
    select,
    text,
)

from core.arrays import Float32s, Ints
from service.collection import CollectionNumber
from service.index.density_samples import FIRST, PRIME, SAMPLE, SECOND
from service.index.repository import stacked
from service.observability.logging import get_logger
from service.shapes.records import ShapeFilter
from service.shapes.repository import matching
from service.storage.checksums import is_whole
from service.storage.columns import POSTGRESQL, PgVector, vector_text
from service.storage.database import ReadSession
from service.storage.hnsw import has_view_signature
from service.storage.tables import (
    NOT_DELETED,
    BlobRow,
    CoarseSamplesRow,
    EmbeddingRow,
    QuantisedPointsRow,
    ShapeRow,
)

log = get_logger("search")

NeighbourQuery = Select[int, int, float]
"""A query of the numbers of shapes and embeddings, and of distances."""

Rows = TypeVar("Rows", bound=Select[*tuple[Any, ...]])

MORE = 2
"""Factor by which the HNSW index returns more signatures than requested: it misses mostly the last ones."""

AT_ONCE = 10_000

MOST_SEEN = 100_000
"""Signatures that the HNSW index visits at most. If too few of them match the filter, all are searched."""


def embedding_records(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """Return the records of embeddings by number, without deleted and damaged ones; these are logged."""
    columns = EmbeddingRow.number, EmbeddingRow.record, EmbeddingRow.checksum
    records = {}
    for row in session.execute(select(*columns).where(EmbeddingRow.number.in_(numbers))):
        if is_whole(row.record, row.checksum):
            records[row.number] = row.record
        else:
            log.error("embedding %d is damaged: it does not have its checksum", row.number)
    return records


def stored_points(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """Return the points of embeddings by number, without deleted and damaged ones; these are logged."""
    columns = QuantisedPointsRow.embedding_number, QuantisedPointsRow.data, QuantisedPointsRow.checksum
    points = {}
    for row in session.execute(select(*columns).where(QuantisedPointsRow.embedding_number.in_(numbers))):
        if is_whole(row.data, row.checksum):
            points[row.embedding_number] = row.data
        else:
            log.error("the points of embedding %d are damaged", row.embedding_number)
    return points


def sampled_embeddings(session: ReadSession, fingerprint: str, collection: CollectionNumber) -> list[int]:
    """Return the embeddings, by one pipeline, of the shapes of a collection's sample, ascending by shape.

    The same as those of `service.index.density_samples.sampled`.
    """
    short = ShapeRow.number % PRIME
    query = (
        select(ShapeRow.number, EmbeddingRow.number)
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .where(EmbeddingRow.fingerprint == fingerprint, ShapeRow.collection_number == collection, NOT_DELETED)
        .order_by((short * short % PRIME * FIRST + short * SECOND) % PRIME, ShapeRow.number)
        .limit(SAMPLE)
    )
    return [embedding for _, embedding in sorted(session.execute(query).all())]


def numbers_of_bytes(session: ReadSession, collection: CollectionNumber, sha256: str) -> list[int]:
    """Return the numbers of a collection's shapes with a SHA-256."""
    query = select(ShapeRow.number).join(BlobRow, BlobRow.number == ShapeRow.blob_number)
    in_collection = ShapeRow.collection_number == collection
    return list(session.scalars(query.where(BlobRow.sha256 == sha256, in_collection, NOT_DELETED)))


def map_shapes(
    session: ReadSession, fingerprint: str, numbers: Ints
) -> tuple[Sequence[str], Sequence[str], Float32s]:
    """Return the ids, names and signatures, shape (n, s), of the shapes that a pipeline has embedded."""
    query = (
        select(ShapeRow.id, ShapeRow.name, CoarseSamplesRow.signature)
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number)
        .where(ShapeRow.number.in_(numbers.tolist()), NOT_DELETED, EmbeddingRow.fingerprint == fingerprint)
        .order_by(ShapeRow.number)
    )
    ids, names, signatures = (
        zip(*rows, strict=True) if (rows := session.execute(query).all()) else ((), (), ())
    )
    return ids, names, stacked(signatures).view("<f4")


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Shapes in the order of their distances, and for equal distances of their numbers.

    Attributes
    ----------
    shapes, embeddings : int64, shape (n,)
        Numbers of the shapes and of their embeddings.
    distances : float64, shape (n,)
        Distances, computed in single precision.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    distances: NDArray[np.float64]

    def only(self, indices: NDArray[np.intp] | NDArray[np.bool_]) -> "Neighbours":
        """Return the shapes at some indices, or those that a mask selects."""
        return Neighbours(self.shapes[indices], self.embeddings[indices], self.distances[indices])


class ShortDescriptors(NamedTuple):
    """Short descriptors of an embedding; the coarse samples may be empty, and the last two be missing."""

    signature: bytes
    coarse_samples: bytes
    view_signature: NDArray[np.uint8] | None
    reliability: float | None


@dataclass(frozen=True, eq=False)
class _Search:
    """A query of neighbours.

    Attributes
    ----------
    vector : shape (s,)
        The vector whose neighbours are wanted.
    column : ColumnElement
        The vectors.
    operator : str
        The distance of pgvector.
    condition : ColumnElement, optional
        The condition of a partial index.
    """

    vector: NDArray[np.float32] | NDArray[np.uint8]
    column: SQLColumnExpression[Any]
    operator: str
    condition: SQLColumnExpression[bool] | None = None


def nearest(
    session: ReadSession,
    fingerprint: str,
    signature: NDArray[np.float32],
    count: int,
    *,
    shapes: ShapeFilter,
    ef_search: int | None,
    more: int = MORE,
) -> Neighbours:
    """Return the shapes with the nearest signatures: `count` shapes, or all if there are fewer.

    Parameters
    ----------
    session : ReadSession
        A session of a PostgreSQL database.
    fingerprint : str
        The fingerprint of the pipeline.
    signature : float32, shape (s,)
    count : int
        Number of shapes to return.
    shapes : ShapeFilter
        The candidates.
    ef_search : int or None
        Size of the candidate list of the HNSW search, 1 to 1,000; None selects exact search, which reads all
        signatures. HNSW search may miss some neighbours, but always returns `count` shapes.
    more : int
        Factor by which the HNSW index returns more shapes, of which the nearest `count` are chosen.
    """
    search = _Search(signature.astype(np.float32), EmbeddingRow.signature, "<->")
    return _nearest(session, fingerprint, search, count, shapes=shapes, ef_search=ef_search, more=more)


def nearest_views(
    session: ReadSession,
    fingerprint: str,
    view_signature: NDArray[np.uint8],
    count: int,
    *,
    shapes: ShapeFilter,
    ef_search: int | None,
) -> Neighbours:
    """Return neighbours as `nearest` does, by the L1 distances of view signatures, shape (v,)."""
    search = _Search(
        view_signature, CoarseSamplesRow.view_signature, "<+>", has_view_signature(len(view_signature))
    )
    return _nearest(session, fingerprint, search, count, shapes=shapes, ef_search=ef_search, more=MORE)


def _nearest(
    session: ReadSession,
    fingerprint: str,
    search: _Search,
    count: int,
    *,
    shapes: ShapeFilter,
    ef_search: int | None,
    more: int,
) -> Neighbours:
    if ef_search is not None:
        for name, value in (
            ("hnsw.ef_search", ef_search),
            ("hnsw.iterative_scan", "relaxed_order"),
            ("hnsw.max_scan_tuples", MOST_SEEN),
        ):
            session.execute(select(func.set_config(name, str(value), True)))
        neighbours = _run(session, _by_hnsw(fingerprint, search, count, shapes, more * count))
        if len(neighbours.shapes) == count:
            return neighbours
    return _run(session, _exactly(fingerprint, search, count, shapes))


def has_at_least(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter, without: Sequence[int], count: int
) -> bool:
    """Return whether at least `count` shapes match a filter, have an embedding and are not in `without`."""
    numbers = _embedded(select(ShapeRow.number), fingerprint, shapes).where(ShapeRow.number.not_in(without))
    first = numbers.limit(count).subquery()
    return (session.scalar(select(func.count()).select_from(first)) or 0) >= count


def signatures(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return the numbers of n shapes and of their embeddings, and their signatures, shape (n, s)."""
    query = select(ShapeRow.number, EmbeddingRow.number, EmbeddingRow.signature)
    query = _embedded(query, fingerprint, shapes).order_by(ShapeRow.number)
    rows = session.execute(query.execution_options(yield_per=AT_ONCE)).all()
    length = len(rows[0][2]) if rows else 0
    return (
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float32).reshape(len(rows), length),
    )


def short_descriptors(session: ReadSession, embeddings: NDArray[np.int64]) -> dict[int, ShortDescriptors]:
    """Return the short descriptors of embeddings by number."""
    query = select(
        CoarseSamplesRow.embedding_number,
        CoarseSamplesRow.signature,
        CoarseSamplesRow.data,
        CoarseSamplesRow.view_signature,
        CoarseSamplesRow.reliability,
    )
    descriptors: dict[int, ShortDescriptors] = {}
    for start in range(0, len(embeddings), AT_ONCE):
        batch = embeddings[start : start + AT_ONCE].tolist()
        rows = session.execute(query.where(CoarseSamplesRow.embedding_number.in_(batch)))
        descriptors |= {row[0]: ShortDescriptors(row[1], row[2], row[3], row[4]) for row in rows}
    return descriptors


def latest(session: ReadSession, fingerprint: str, count: int) -> list[int]:
    """Return the numbers of a pipeline's latest embeddings, the latest first."""
    query = select(EmbeddingRow.number).where(EmbeddingRow.fingerprint == fingerprint)
    return list(session.scalars(query.order_by(EmbeddingRow.number.desc()).limit(count)))


def _by_hnsw(
    fingerprint: str, search: _Search, count: int, shapes: ShapeFilter, taken: int
) -> NeighbourQuery:
    """Return a query by the expression of the HNSW index, which returns rows in approximate order."""
    by_index = replace(search, column=cast(search.column, PgVector(len(search.vector))))
    nearest_rows = _distances(fingerprint, by_index, shapes).limit(taken)
    near = nearest_rows.order_by(text("distance")).cte("near").prefix_with("MATERIALIZED", dialect=POSTGRESQL)
    # PostgreSQL takes the rows of the index for sorted. Adding zero makes it sort them.
    order = near.c.distance + literal(0.0, literal_execute=True)
    return select(near.c.shape, near.c.embedding, near.c.distance).order_by(order, near.c.shape).limit(count)


def _exactly(fingerprint: str, search: _Search, count: int, shapes: ShapeFilter) -> NeighbourQuery:
    """Return a query by an expression without an index, so that PostgreSQL computes all distances."""
    return _distances(fingerprint, search, shapes).order_by("distance", "shape").limit(count)


def _distances(fingerprint: str, search: _Search, shapes: ShapeFilter) -> NeighbourQuery:
    vector = cast(literal(vector_text(search.vector), String), PgVector(len(search.vector)))
    query = _embedded(
        select(
            ShapeRow.number.label("shape"),
            EmbeddingRow.number.label("embedding"),
            search.column.op(search.operator, return_type=Float())(vector).label("distance"),
        ),
        fingerprint,
        shapes,
    )
    if search.condition is None:
        return query
    return query.join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number).where(
        search.condition
    )


def _embedded(query: Rows, fingerprint: str, shapes: ShapeFilter) -> Rows:
    """Restrict a query to shapes that match a filter, and to their embeddings by a pipeline."""
    query = query.join(
        EmbeddingRow,
        (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
    )
    # A literal, so that the planner can choose the partial index of the pipeline.
    query = query.where(
        EmbeddingRow.fingerprint == bindparam(None, fingerprint, literal_execute=True),
        ShapeRow.collection_number == shapes.collection,
        NOT_DELETED,
    )
    return query if shapes.is_empty else query.where(ShapeRow.number.in_(matching(shapes)))


def _run(session: ReadSession, query: NeighbourQuery) -> Neighbours:
    rows = session.execute(query).all()
    return Neighbours(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float64),
    )
