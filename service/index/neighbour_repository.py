"""The SQL of the graph of neighbours: the nearest neighbours of each stored shape, by log odds.

A query reads the rows around its candidates, a millisecond for some hundred: so a service keeps none of the
graph in memory, and sees what other services have written.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import Select, delete, func, select, update

from core.arrays import Floats, Ints
from core.ranking.diffusion import NEIGHBOURS, NOBODY, NeighbourRows
from service.collection import CollectionNumber
from service.index.repository import ENTRIES, has_embedding
from service.observability.logging import get_logger
from service.storage.checksums import checksum_of, is_whole
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import EmbeddingRow, NeighboursRow, ShapeRow

log = get_logger("search")

Rows = TypeVar("Rows", bound=Select[*tuple[Any, ...]])

AT_ONCE = 10_000
"""Rows that one statement reads: PostgreSQL takes no more than 65,535 values."""

NEIGHBOUR = np.dtype([("shape", "<i8"), ("log_odds", "<f4")])
"""A neighbour in the bytes of a row."""


def neighbour_rows(session: ReadSession, fingerprint: str, shapes: Ints | None = None) -> NeighbourRows:
    """Return the rows, by a pipeline, of some shapes or of all; damaged ones are left out, and logged."""
    row = NeighboursRow
    query = select(row.shape_number, row.data, row.checksum).where(row.fingerprint == fingerprint)
    queries = [query]
    if shapes is not None:
        numbers = np.sort(shapes).tolist()
        batches = (numbers[start : start + AT_ONCE] for start in range(0, len(numbers), AT_ONCE))
        queries = [query.where(row.shape_number.in_(batch)) for batch in batches]
    rows = (each for query in queries for each in session.execute(query.order_by(row.shape_number)))
    found = []
    for number, data, checksum in rows:
        if is_whole(data, checksum):
            found.append((number, np.frombuffer(data, NEIGHBOUR)))
        else:
            log.error(
                "the neighbours of shape number %d are damaged: they do not have their checksum", number
            )
    neighbours = np.full((len(found), NEIGHBOURS), NOBODY)
    log_odds = np.full((len(found), NEIGHBOURS), -np.inf)
    for i, (_, nearest) in enumerate(found):
        neighbours[i, : len(nearest)] = nearest["shape"][:NEIGHBOURS]
        log_odds[i, : len(nearest)] = nearest["log_odds"][:NEIGHBOURS]
    return NeighbourRows(np.array([number for number, _ in found], dtype=np.int64), neighbours, log_odds)


def lacking(session: ReadSession, fingerprint: str, limit: int) -> list[tuple[CollectionNumber, int, int]]:
    """Return at most `limit` embedded shapes without a row: collection, number, embedding; oldest first."""
    columns = ShapeRow.collection_number, ShapeRow.number, EmbeddingRow.number
    query = _without_rows(ENTRIES.with_only_columns(*columns), fingerprint)
    rows = session.execute(query.order_by(ShapeRow.number).limit(limit))
    return [(CollectionNumber(of), shape, embedding) for of, shape, embedding in rows]


def count_lacking(session: ReadSession, fingerprint: str, collection: CollectionNumber) -> int:
    """Return the number of embedded shapes of a collection without a row."""
    query = _without_rows(ENTRIES.with_only_columns(func.count()), fingerprint)
    return session.scalar(query.where(ShapeRow.collection_number == collection)) or 0


@dataclass(frozen=True, eq=False)
class Compared:
    """A shape, and those that it was compared with.

    `shape` and `embedding` are numbers, `others` has those of c shapes, and `log_odds` the log odds that the
    shape and each of these are of one class, both of shape (c,).
    """

    shape: int
    embedding: int
    others: Ints
    log_odds: Floats


def write(session: WriteSession, fingerprint: str, rows: Iterable[Compared]) -> None:
    """Store the rows of shapes, and put these into the rows of the shapes that they are among the nearest of.

    Nothing is stored of a shape that does not have its embedding any more.
    """
    for row in rows:
        if has_embedding(session, row.shape, row.embedding):
            _write(session, fingerprint, row)


def _write(session: WriteSession, fingerprint: str, row: Compared) -> None:
    columns = columns_of(fingerprint, row.shape, row.others, row.log_odds)
    session.merge(NeighboursRow(**columns))
    kept = neighbour_rows(session, fingerprint, row.others)
    of = dict(zip(row.others.tolist(), row.log_odds.tolist(), strict=True))
    changed = []
    for other, neighbours, values in zip(kept.shapes.tolist(), kept.neighbours, kept.log_odds, strict=True):
        others = (neighbours != row.shape) & (neighbours != NOBODY)
        if others.all() and of[other] <= values[-1]:
            continue
        nearest, log_odds = np.append(neighbours[others], row.shape), np.append(values[others], of[other])
        changed.append(columns_of(fingerprint, other, nearest, log_odds))
    if changed:
        session.execute(update(NeighboursRow), changed)


def forget(session: WriteSession, number: int) -> None:
    """Delete the rows of a shape and of its neighbours, which are made again without the shape."""
    row = NeighboursRow
    rows = session.scalars(select(row.data).where(row.shape_number == number)).all()
    numbers = {number, *(int(each) for data in rows for each in np.frombuffer(data, NEIGHBOUR)["shape"])}
    session.execute(delete(row).where(row.shape_number.in_(numbers)))


def columns_of(fingerprint: str, shape: int, neighbours: Ints, log_odds: Floats) -> dict[str, Any]:
    """Return the columns of the row of a shape, by number, from the nearest of some neighbours."""
    nearest = np.lexsort((neighbours, -log_odds))[:NEIGHBOURS]
    row = np.empty(len(nearest), NEIGHBOUR)
    row["shape"], row["log_odds"] = neighbours[nearest], log_odds[nearest]
    data = row.tobytes()
    return {"shape_number": shape, "fingerprint": fingerprint, "data": data, "checksum": checksum_of(data)}


def _without_rows(query: Rows, fingerprint: str) -> Rows:
    row = NeighboursRow
    made = select(row.shape_number).where(row.shape_number == ShapeRow.number, row.fingerprint == fingerprint)
    return query.where(EmbeddingRow.fingerprint == fingerprint, ~made.exists())
