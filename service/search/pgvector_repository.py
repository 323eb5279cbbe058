"""The SQL of the nearest signatures, by PostgreSQL: exactly, or by the graph of `service.storage.hnsw`.

With these no signature need be in the service's memory. They are for databases that have graphs; elsewhere
there is `service.index.signature_index`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

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

from service.shapes.records import ShapeFilter
from service.shapes.repository import matching
from service.storage.columns import POSTGRESQL, PgVector, vector_text
from service.storage.database import ReadSession
from service.storage.tables import EmbeddingRow, ShapeRow, SketchRow

Found = Select[int, int, float]
Chosen = TypeVar("Chosen", bound=Select[*tuple[Any, ...]])

MORE = 2
"""So many times as many are taken from the graph as are wanted, unless told: it misses mostly the last."""

AT_ONCE = 10_000

MOST_SEEN = 100_000
"""The graph is left, and all are searched, where a filter means so few that this many are not enough."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """Shapes in the order of their distance, those at one distance in the order of their numbers.

    Attributes
    ----------
    shapes, embeddings : int64, shape (n,)
        Their numbers, and those of their embeddings.
    distances : float64, shape (n,)
        Euclidean, between signatures; computed in single precision.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    distances: NDArray[np.float64]


def nearest(
    session: ReadSession,
    fingerprint: str,
    signature: NDArray[np.float32],
    count: int,
    *,
    shapes: ShapeFilter,
    ef_search: int | None,
    more: int = MORE,
) -> Nearest:
    """The shapes with the nearest signatures of one pipeline, as many as are wanted or there are.

    Parameters
    ----------
    session : ReadSession
        Of a PostgreSQL database.
    signature : float32, shape (s,)
    count : int
        How many are wanted.
    shapes : ShapeFilter
        Which are meant.
    ef_search : int or None
        How many near ones the search of the graph keeps in mind, 1 to 1,000; None is the exact search, which
        reads all signatures. The graph may miss some of the nearest, yet gives as many as are wanted.
    more : int
        How many times as many are taken from the graph as are wanted, to be put in order by distance.
    """
    if ef_search is not None:
        for name, value in (
            ("hnsw.ef_search", ef_search),
            ("hnsw.iterative_scan", "relaxed_order"),
            ("hnsw.max_scan_tuples", MOST_SEEN),
        ):
            session.execute(select(func.set_config(name, str(value), True)))
        found = _run(session, _by_graph(fingerprint, signature, count, shapes, more * count))
        if len(found.shapes) == count:
            return found
    return _run(session, _exactly(fingerprint, signature, count, shapes))


def is_many(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter, without: Sequence[int], many: int
) -> bool:
    """Whether a pipeline embedded so many of the shapes that are meant, or more, without some numbers."""
    found = _embedded(select(ShapeRow.number), fingerprint, shapes).where(ShapeRow.number.not_in(without))
    some = found.limit(many).subquery()
    return (session.scalar(select(func.count()).select_from(some)) or 0) >= many


def signatures(
    session: ReadSession, fingerprint: str, shapes: ShapeFilter
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """The numbers of all shapes that are meant, of their embeddings, and their signatures, (n, s)."""
    query = select(ShapeRow.number, EmbeddingRow.number, EmbeddingRow.signature)
    found = _embedded(query, fingerprint, shapes).order_by(ShapeRow.number)
    rows = session.execute(found.execution_options(yield_per=AT_ONCE)).all()
    length = len(rows[0][2]) if rows else 0
    return (
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float32).reshape(len(rows), length),
    )


def entries(session: ReadSession, embeddings: NDArray[np.int64]) -> dict[int, tuple[bytes, bytes]]:
    """The signatures of embeddings and their sketches, which may be empty, by number."""
    query = select(SketchRow.embedding_number, SketchRow.signature, SketchRow.data)
    found: dict[int, tuple[bytes, bytes]] = {}
    for start in range(0, len(embeddings), AT_ONCE):
        some = embeddings[start : start + AT_ONCE].tolist()
        for number, signature, sketch in session.execute(query.where(SketchRow.embedding_number.in_(some))):
            found[number] = (signature, sketch)
    return found


def latest(session: ReadSession, fingerprint: str, count: int) -> list[int]:
    """The numbers of a pipeline's newest embeddings, the newest first."""
    query = select(EmbeddingRow.number).where(EmbeddingRow.fingerprint == fingerprint)
    return list(session.scalars(query.order_by(EmbeddingRow.number.desc()).limit(count)))


def _by_graph(
    fingerprint: str, signature: NDArray[np.float32], count: int, shapes: ShapeFilter, taken: int
) -> Found:
    """In the order of an expression that is the graph's; the graph gives nearly this order."""
    expression = cast(EmbeddingRow.signature, PgVector(len(signature)))
    some = _distances(fingerprint, expression, signature, shapes).limit(taken)
    near = some.order_by(text("distance")).cte("near").prefix_with("MATERIALIZED", dialect=POSTGRESQL)
    # Plus nothing, since what the graph gives counts as ordered already, and PostgreSQL would not order it.
    order = near.c.distance + literal(0.0, literal_execute=True)
    return select(near.c.shape, near.c.embedding, near.c.distance).order_by(order, near.c.shape).limit(count)


def _exactly(fingerprint: str, signature: NDArray[np.float32], count: int, shapes: ShapeFilter) -> Found:
    """In the order of an expression that is no graph's."""
    found = _distances(fingerprint, EmbeddingRow.signature, signature, shapes)
    return found.order_by("distance", "shape").limit(count)


def _distances(
    fingerprint: str, vector: SQLColumnExpression[Any], signature: NDArray[np.float32], shapes: ShapeFilter
) -> Found:
    wanted = cast(literal(vector_text(signature.astype(np.float32)), String), PgVector(len(signature)))
    query = select(
        ShapeRow.number.label("shape"),
        EmbeddingRow.number.label("embedding"),
        vector.op("<->", return_type=Float())(wanted).label("distance"),
    )
    return _embedded(query, fingerprint, shapes)


def _embedded(query: Chosen, fingerprint: str, shapes: ShapeFilter) -> Chosen:
    """Of shapes and their embeddings, those that are meant and that a pipeline made."""
    query = query.join(
        EmbeddingRow,
        (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
    )
    # Written out, so that the planner sees which pipeline's graph it is.
    query = query.where(
        EmbeddingRow.fingerprint == bindparam(None, fingerprint, literal_execute=True),
        ShapeRow.collection_number == shapes.collection,
    )
    return query if shapes.is_empty else query.where(ShapeRow.number.in_(matching(shapes)))


def _run(session: ReadSession, query: Found) -> Nearest:
    rows = session.execute(query).all()
    return Nearest(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float64),
    )
