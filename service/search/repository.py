"""The SQL of search: records by embedding, and nearest signatures in PostgreSQL with pgvector.

PostgreSQL finds neighbours by exact search, or by an HNSW index (`service.storage.postgresql`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    Float,
    Row,
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
from core.descriptors.pieces import WIDTH
from service.collection import CollectionNumber
from service.index.cache import FIRST, PRIME, SAMPLE, SECOND
from service.index.repository import ENTRIES, OF_SHAPE, IndexEntries, entries_of, stacked
from service.observability.logging import get_logger
from service.shapes.records import FileKey, ShapeFilter
from service.shapes.repository import matching
from service.storage.checksums import is_whole
from service.storage.columns import POSTGRESQL, PgVector, vector_text
from service.storage.database import ReadSession
from service.storage.postgresql import has_view_signature
from service.storage.tables import NOT_DELETED, BlobRow, CoarseSamplesRow, EmbeddingRow, PieceRow, ShapeRow

log = get_logger("search")

Rows = TypeVar("Rows", bound=Select[*tuple[Any, ...]])

MORE = 2
"""Factor by which the HNSW index returns more signatures than requested: it misses mostly the last ones."""

AT_ONCE, MOST_PIECES = 10_000, 200_000
"""Shapes in one statement, and pieces that a query reads."""

MOST_SEEN = 100_000
"""Signatures that the HNSW index visits at most. If too few of them match the filter, all are searched."""


def embedding_records(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """Return the records of embeddings by number, without deleted and damaged ones; these are logged."""
    row = EmbeddingRow
    query = select(row.number, row.record, row.checksum).where(row.number.in_(numbers))
    whole = {}
    for number, record, checksum in session.execute(query):
        if is_whole(record, checksum):
            whole[number] = record
        else:
            log.error("embedding %d is damaged: it does not have its checksum", number)
    return whole


def sampled_embeddings(session: ReadSession, fingerprint: str, collection: CollectionNumber) -> list[int]:
    """Return the embeddings, by one pipeline, of the shapes of a collection's sample, ascending by shape.

    The same as those of `service.index.cache.sampled`.
    """
    short = ShapeRow.number % PRIME
    query = (
        select(ShapeRow.number, EmbeddingRow.number)
        .join(EmbeddingRow, OF_SHAPE)
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


@dataclass(frozen=True, eq=False)
class MappedShapes:
    """The numbers, ids, names, files and signatures, shape (n, s), of the n shapes of a map."""

    numbers: Ints
    ids: Sequence[str]
    names: Sequence[str]
    files: Sequence[FileKey]
    signatures: Float32s


def map_shapes(session: ReadSession, fingerprint: str, numbers: Ints) -> MappedShapes:
    """Return those of some shapes that a pipeline has embedded, the oldest first."""
    columns = (
        *(ShapeRow.number, ShapeRow.id, ShapeRow.name),
        *(BlobRow.sha256, ShapeRow.format, CoarseSamplesRow.signature),
    )
    query = (
        ENTRIES.with_only_columns(*columns)
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .where(ShapeRow.number.in_(numbers.tolist()), EmbeddingRow.fingerprint == fingerprint)
    )
    rows = session.execute(query.order_by(ShapeRow.number)).all()
    return MappedShapes(
        numbers=np.array([row[0] for row in rows], dtype=np.int64),
        ids=[row[1] for row in rows],
        names=[row[2] for row in rows],
        files=[(row[3], row[4]) for row in rows],
        signatures=stacked([row[5] for row in rows]).view("<f4"),
    )


def nearest(
    session: ReadSession,
    fingerprint: str,
    vector: NDArray[np.float32] | NDArray[np.uint8],
    count: int,
    *,
    shapes: ShapeFilter,
    ef_search: int | None,
    views: bool = False,
    more: int = MORE,
) -> Ints:
    """Return the numbers of the shapes with the nearest signatures: `count`, or all if there are fewer.

    They are in the order of their distances in single precision, and for equal distances of their numbers.

    Parameters
    ----------
    session : ReadSession
        A session of a PostgreSQL database.
    fingerprint : str
        The fingerprint of the pipeline.
    vector : float32 or uint8, shape (s,)
        A signature or, with `views`, a view signature. Distances are Euclidean or, with `views`, L1.
    count : int
        Number of shapes to return.
    shapes : ShapeFilter
        The candidates.
    ef_search : int or None
        Size of the candidate list of the HNSW search, 1 to 1,000; None selects exact search, which reads all
        vectors. HNSW search may miss some neighbours, but always returns `count` shapes.
    views : bool
    more : int
        Factor by which the HNSW index returns more shapes, of which the nearest `count` are chosen.
    """
    length = PgVector(len(vector))

    def distances(column: SQLColumnExpression[Any]) -> Select[int, float]:
        distance = column.op("<+>" if views else "<->", return_type=Float())
        text_of_vector = cast(literal(vector_text(vector), String), length)
        columns = select(ShapeRow.number.label("shape"), distance(text_of_vector).label("distance"))
        query = _embedded(columns, fingerprint, shapes)
        if not views:
            return query
        query = query.join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number)
        return query.where(has_view_signature(len(vector)))

    column = CoarseSamplesRow.view_signature if views else EmbeddingRow.signature
    if ef_search is not None:
        for name, value in (
            ("hnsw.ef_search", ef_search),
            ("hnsw.iterative_scan", "relaxed_order"),
            ("hnsw.max_scan_tuples", MOST_SEEN),
        ):
            session.execute(select(func.set_config(name, str(value), True)))
        # The expression of the HNSW index, which returns rows in approximate order.
        rows = distances(cast(column, length)).limit(more * count).order_by(text("distance"))
        near = rows.cte("near").prefix_with("MATERIALIZED", dialect=POSTGRESQL)
        # PostgreSQL takes the rows of the index for sorted. Adding zero makes it sort them.
        order = near.c.distance + literal(0.0, literal_execute=True)
        query = select(near.c.shape).order_by(order, near.c.shape).limit(count)
        neighbours = session.execute(query).scalars().all()
        if len(neighbours) == count:
            return np.array(neighbours, dtype=np.int64)
    # An expression without an index: PostgreSQL computes all distances.
    exact = distances(column).order_by("distance", "shape").limit(count)
    return np.array(session.execute(exact).scalars().all(), dtype=np.int64)


def has_at_least(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter, without: Sequence[int], count: int
) -> bool:
    """Return whether at least `count` shapes match a filter, have an embedding and are not in `without`."""
    numbers = _embedded(select(ShapeRow.number), fingerprint, shapes).where(ShapeRow.number.not_in(without))
    first = numbers.limit(count).subquery()
    return (session.scalar(select(func.count()).select_from(first)) or 0) >= count


def entries(session: ReadSession, fingerprint: str, shapes: ShapeFilter | Ints) -> IndexEntries:
    """Return the embedded shapes that match a filter, or that have some numbers."""
    if isinstance(shapes, ShapeFilter):
        conditions = [ShapeRow.number.in_(matching(shapes))]
    else:
        batches = [shapes[start : start + AT_ONCE] for start in range(0, len(shapes), AT_ONCE)]
        conditions = [ShapeRow.number.in_(batch.tolist()) for batch in batches]
    query = ENTRIES.where(EmbeddingRow.fingerprint == fingerprint)
    return entries_of([row for condition in conditions for row in session.execute(query.where(condition))])


def pieces(
    session: ReadSession, sizes: Sequence[tuple[float, float]], *, of_several: bool
) -> tuple[Ints, Float32s]:
    """Return the pieces of a size in one of the disjoint ranges `sizes`: embeddings, shape (k,), and rows.

    The size is the root of the area. They are the pieces of surfaces of several pieces, or else of one, of
    all pipelines and collections; at most `MOST_PIECES`, those of the first ranges, and there the oldest.
    """
    found: list[Row[int, bytes]] = []
    for least, greatest in sizes:
        query = (
            select(PieceRow.embedding_number, PieceRow.lengths)
            .where(PieceRow.of_several == of_several, PieceRow.size.between(least, greatest))
            .order_by(PieceRow.embedding_number)
            .limit(MOST_PIECES - len(found))
        )
        found += session.connection().execute(query).all()
    embeddings = np.array([number for number, _ in found], dtype=np.int64)
    return embeddings, stacked([lengths for _, lengths in found]).view("<f4").reshape(-1, WIDTH)


def shapes_of(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter, embeddings: Ints
) -> list[tuple[int, int]]:
    """Return the shapes, with their embeddings, that match a filter and have one of some embeddings."""
    # The embeddings come first, and the filter is applied to their shapes afterwards: SQLite would look up
    # every shape of the collection, as it takes any equality for a rare one.
    of_shape = ShapeRow.number, ShapeRow.collection_number, ShapeRow.deleted_at
    found = []
    for start in range(0, len(embeddings), AT_ONCE):
        batch = embeddings[start : start + AT_ONCE].tolist()
        embedded = select(*of_shape, EmbeddingRow.number.label("embedding")).join(EmbeddingRow, OF_SHAPE)
        near = (
            embedded.where(EmbeddingRow.number.in_(batch), EmbeddingRow.fingerprint == fingerprint)
            .cte("near")
            .prefix_with("MATERIALIZED")
        )
        query = select(near.c.number, near.c.embedding).where(
            near.c.collection_number == shapes.collection, near.c.deleted_at.is_(None)
        )
        if not shapes.is_empty:
            query = query.where(near.c.number.in_(matching(shapes)))
        found += [(shape, embedding) for shape, embedding in session.execute(query)]
    return found


def latest(session: ReadSession, fingerprint: str, count: int) -> list[int]:
    """Return the numbers of a pipeline's latest embeddings, the latest first."""
    query = select(EmbeddingRow.number).where(EmbeddingRow.fingerprint == fingerprint)
    return list(session.scalars(query.order_by(EmbeddingRow.number.desc()).limit(count)))


def _embedded(query: Rows, fingerprint: str, shapes: ShapeFilter) -> Rows:
    """Restrict a query to shapes that match a filter, and to their embeddings by a pipeline."""
    # A literal, so that the planner can choose the partial index of the pipeline.
    query = query.join(EmbeddingRow, OF_SHAPE).where(
        EmbeddingRow.fingerprint == bindparam(None, fingerprint, literal_execute=True),
        ShapeRow.collection_number == shapes.collection,
        NOT_DELETED,
    )
    return query if shapes.is_empty else query.where(ShapeRow.number.in_(matching(shapes)))
