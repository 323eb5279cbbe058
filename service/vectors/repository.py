"""The SQL of the nearest signatures, by PostgreSQL: exactly, or by the graph of `service.storage.graph`.

With these no signature need be in the service's memory. They are for databases that have graphs; elsewhere
there is `service.search.signatures`.
"""

from dataclasses import dataclass
from typing import Any

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
from service.storage.tables import EmbeddingRow, ShapeRow

Found = Select[int, int, float]

MORE = 2
"""So many times as many are taken from the graph as are wanted: then hardly one of the nearest is missed."""

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
    """
    if ef_search is not None:
        for name, value in (
            ("hnsw.ef_search", ef_search),
            ("hnsw.iterative_scan", "relaxed_order"),
            ("hnsw.max_scan_tuples", MOST_SEEN),
        ):
            session.execute(select(func.set_config(name, str(value), True)))
        found = _run(session, _by_graph(fingerprint, signature, count, shapes))
        if len(found.shapes) == count:
            return found
    return _run(session, _exactly(fingerprint, signature, count, shapes))


def _by_graph(fingerprint: str, signature: NDArray[np.float32], count: int, shapes: ShapeFilter) -> Found:
    """In the order of an expression that is the graph's; the graph gives nearly this order."""
    expression = cast(EmbeddingRow.signature, PgVector(len(signature)))
    some = _distances(fingerprint, expression, signature, shapes).limit(MORE * count)
    near = some.order_by(text("distance")).cte("near").prefix_with("MATERIALIZED", dialect=POSTGRESQL)
    return select(near.c.shape, near.c.embedding, near.c.distance).order_by("distance", "shape").limit(count)


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
    ).join(
        EmbeddingRow,
        (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
    )
    # Written out, so that the planner sees which pipeline's graph it is.
    query = query.where(EmbeddingRow.fingerprint == bindparam(None, fingerprint, literal_execute=True))
    return query if shapes.is_empty else query.where(ShapeRow.number.in_(matching(shapes)))


def _run(session: ReadSession, query: Found) -> Nearest:
    rows = session.execute(query).all()
    return Nearest(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float64),
    )
