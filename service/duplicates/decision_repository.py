"""The SQL of decisions on near-identical shapes."""

import uuid
from collections.abc import Collection, Iterable, Sequence
from datetime import UTC, datetime

from sqlalchemy import delete, func, insert, select, tuple_

from service.collection import CollectionNumber
from service.duplicates.decision_schemas import DecidedPair, DecidedSide
from service.duplicates.records import Decision, Pair
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import NOT_DELETED, BlobRow, DuplicateDecisionRow, ShapeRow

AT_ONCE = 1_000


def decide(
    session: WriteSession,
    collection: CollectionNumber,
    pairs: Collection[Pair],
    decision: Decision,
    decided_by: str | None,
    reason: str,
) -> str:
    """Store a decision on pairs, in the place of earlier ones, and return its id."""
    row = DuplicateDecisionRow
    act, ordered = str(uuid.uuid4()), sorted(pairs)
    values = {"id": act, "collection_number": collection, "decision": decision, "decided_by": decided_by}
    values |= {"reason": reason, "decided_at": datetime.now(UTC)}
    for start in range(0, len(ordered), AT_ONCE):
        some = ordered[start : start + AT_ONCE]
        same = tuple_(row.first_sha256, row.second_sha256).in_(some)
        session.execute(delete(row).where(row.collection_number == collection, same))
        hashes = [{"first_sha256": first, "second_sha256": second} for first, second in some]
        session.execute(insert(row), [{**values, **pair} for pair in hashes])
    return act


def decided(session: ReadSession, collection: CollectionNumber) -> dict[Pair, Decision]:
    """Return the decisions of a collection by their pairs."""
    row = DuplicateDecisionRow
    query = select(row.first_sha256, row.second_sha256, row.decision)
    rows = session.execute(query.where(row.collection_number == collection))
    return {(first, second): decision for first, second, decision in rows}


def hashes(session: ReadSession, shapes: Iterable[int]) -> dict[int, str]:
    """Return the SHA-256 of the files of shapes, by their numbers."""
    numbers = sorted(shapes)
    query = select(ShapeRow.number, BlobRow.sha256).join(BlobRow, BlobRow.number == ShapeRow.blob_number)
    return {
        number: sha256
        for start in range(0, len(numbers), AT_ONCE)
        for number, sha256 in session.execute(
            query.where(ShapeRow.number.in_(numbers[start : start + AT_ONCE]))
        )
    }


def page(
    session: ReadSession, collection: CollectionNumber, *, after: int, limit: int
) -> list[tuple[int, DecidedPair]]:
    """Return the next `limit` decisions of a collection by number, the oldest first."""
    row = DuplicateDecisionRow
    query = select(row).where(row.collection_number == collection, row.number > after)
    rows = session.scalars(query.order_by(row.number).limit(limit)).all()
    return [(each.number, pair) for each, pair in zip(rows, _named(session, collection, rows), strict=True)]


def latest(
    session: ReadSession, collection: CollectionNumber, *, limit: int
) -> list[tuple[int, DecidedPair]]:
    """Return the number of pairs of each of the latest decisions, the latest first, and its first pair."""
    row = DuplicateDecisionRow
    acts = select(func.min(row.number), func.count()).where(row.collection_number == collection)
    acts = acts.group_by(row.id).order_by(func.max(row.number).desc()).limit(limit)
    pairs = dict(session.execute(acts).all())
    rows = {each.number: each for each in session.scalars(select(row).where(row.number.in_(list(pairs))))}
    named = _named(session, collection, [rows[number] for number in pairs])
    return list(zip(pairs.values(), named, strict=True))


def _named(
    session: ReadSession, collection: CollectionNumber, rows: Sequence[DuplicateDecisionRow]
) -> list[DecidedPair]:
    """Return decided pairs with the names of their shapes."""
    wanted = {sha256 for each in rows for sha256 in (each.first_sha256, each.second_sha256)}
    named = (
        select(BlobRow.sha256, ShapeRow.id, ShapeRow.name)
        .join(ShapeRow, ShapeRow.blob_number == BlobRow.number)
        .where(BlobRow.sha256.in_(wanted), ShapeRow.collection_number == collection, NOT_DELETED)
        .order_by(ShapeRow.number)
    )
    shapes: dict[str, dict[str, str]] = {}
    for sha256, shape_id, name in session.execute(named):
        shapes.setdefault(sha256, {})[shape_id] = name
    sides = {sha256: DecidedSide(sha256=sha256, shapes=shapes.get(sha256, {})) for sha256 in wanted}
    return [
        DecidedPair(
            id=each.id,
            decision=each.decision,
            decided_by=each.decided_by,
            reason=each.reason,
            decided_at=each.decided_at,
            first=sides[each.first_sha256],
            second=sides[each.second_sha256],
        )
        for each in rows
    ]


def count(session: ReadSession, collection: CollectionNumber) -> int:
    """Return the number of the decided pairs of a collection."""
    row = DuplicateDecisionRow
    return session.scalar(select(func.count()).where(row.collection_number == collection)) or 0


def remove(session: WriteSession, collection: CollectionNumber, decision_id: str) -> bool:
    """Delete a decision on all its pairs; return whether the collection has it."""
    row = DuplicateDecisionRow
    wanted = row.collection_number == collection, row.id == decision_id
    present = session.scalar(select(row.number).where(*wanted).limit(1)) is not None
    session.execute(delete(row).where(*wanted))
    return present
