"""The SQL of webhooks: what is new since the last message of a kind, and the message that is not delivered.

One transaction at a time writes, so that shapes and judgements are numbered in the order of their commits,
and a number is all that is kept of what was told. One message tells all that is new, and the next is made
when it is delivered or given up.
"""

import json
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import Select, case, func, or_, select, update
from sqlalchemy.orm import aliased

from service.jobs.schemas import ENDED
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import (
    CollectionRow,
    DuplicatePairRow,
    JobRow,
    JudgedShapeRow,
    ShapeRow,
    WebhookRow,
)

MOST = 500
"""Shapes, judgements or jobs that one message tells of."""

FIRST_PAUSE, LONGEST_PAUSE = timedelta(seconds=20), timedelta(hours=1)
"""The time between the first two attempts to deliver a message, which grows fourfold, and the longest.

A receiver has less time to answer, so that no other service sends the message meanwhile.
"""

ATTEMPTS = 30
"""Attempts to deliver a message, over a day."""

Item = dict[str, Any]
Items = tuple[int, list[Item]]
"""The number of the last row that a message tells of, and what it tells."""


@dataclass(frozen=True)
class Message:
    """A message to deliver: its kind, its id, its JSON, and how many attempts were made."""

    kind: str
    id: str
    body: str
    attempts: int


def latest(session: ReadSession) -> dict[str, int]:
    """Return the number of the latest row of each kind that messages tell of."""
    return {kind: session.scalar(number) or 0 for kind, (number, _) in KINDS.items()}


def begin(session: WriteSession) -> None:
    """Have messages tell of what is stored from now on, unless they do already."""
    if waiting(session):
        return
    session.execute(update(JobRow).where(_UNTOLD).values(told=True))
    session.add_all(WebhookRow(kind=kind, told=told, attempts=0) for kind, told in latest(session).items())


def waiting(session: ReadSession) -> list[WebhookRow]:
    """Return what was told of each kind, and the messages that wait."""
    return list(session.scalars(select(WebhookRow).order_by(WebhookRow.kind)))


def make(session: WriteSession, kind: str) -> None:
    """Make a message of the new rows of a kind, unless one waits or there are none to tell of."""
    row = session.get_one(WebhookRow, kind)
    if row.body is not None:
        return
    row.told, items = KINDS[kind][1](session, row.told, latest(session)[kind])
    if items:
        now = datetime.now(UTC)
        row.id, row.attempts, row.due_at = f"msg_{uuid.uuid4().hex}", 0, now
        row.body = json.dumps({"type": kind, "timestamp": now.isoformat(), "data": items})


def is_due(row: WebhookRow) -> bool:
    """Return whether a message is due. A time beyond the longest pause is from a clock that was set back."""
    now = datetime.now(UTC)
    return row.due_at is not None and not now < row.due_at <= now + LONGEST_PAUSE


def take(session: WriteSession, kind: str) -> Message | None:
    """Count an attempt to deliver the message of a kind, which is due again after a pause.

    None if no message is due, as when another service takes it.
    """
    row = session.get_one(WebhookRow, kind)
    if row.body is None or row.id is None or not is_due(row):
        return None
    row.due_at = datetime.now(UTC) + min(FIRST_PAUSE * 4 ** min(row.attempts, 9), LONGEST_PAUSE)
    row.attempts += 1
    return Message(kind, row.id, row.body, row.attempts)


def settle(session: WriteSession, message: Message) -> None:
    """Forget a message that is delivered or given up."""
    of_message = WebhookRow.kind == message.kind, WebhookRow.id == message.id
    session.execute(update(WebhookRow).where(*of_message).values(body=None, due_at=None))


def _stored(session: ReadSession, told: int, until: int) -> Items:
    """Return the shapes that were stored, or moved to another collection."""
    query = (
        select(ShapeRow, CollectionRow.name)
        .join(CollectionRow, CollectionRow.number == ShapeRow.collection_number)
        .where(ShapeRow.number > told, ShapeRow.number <= until)
        .order_by(ShapeRow.number)
        .limit(MOST)
    )
    rows = session.execute(query).all()
    items = [{"collection": name, **_named(shape)} for shape, name in rows if shape.deleted_at is None]
    return rows[-1][0].number if len(rows) == MOST else until, items


def _named(shape: ShapeRow) -> Item:
    """Return the id and the name of a shape."""
    return {"id": shape.id, "name": shape.name}


def _duplicates(session: ReadSession, told: int, until: int) -> Items:
    """Return the pairs of copies and of variants that judgements have found.

    A pair is told with the later of the judgements of its shapes. After `isoshape reembed` it is found again.
    """
    judged = (
        select(JudgedShapeRow.number, JudgedShapeRow.shape_number)
        .where(JudgedShapeRow.number > told, JudgedShapeRow.number <= until)
        .order_by(JudgedShapeRow.number)
        .limit(MOST)
    )
    rows = session.execute(judged).all()
    last = rows[-1].number if len(rows) == MOST else until
    shapes = {row.shape_number for row in rows}
    pair, first, second = DuplicatePairRow, aliased(ShapeRow), aliased(ShapeRow)
    of_first, of_second = aliased(JudgedShapeRow), aliased(JudgedShapeRow)
    later = case((of_first.number > of_second.number, of_first.number), else_=of_second.number)
    query = select(CollectionRow.name, first, second, pair.variant).select_from(pair)
    for shape, judgement, number in (
        (first, of_first, pair.first_number),
        (second, of_second, pair.second_number),
    ):
        same_search = judgement.fingerprint == pair.fingerprint, judgement.variants == pair.variant
        query = query.join(shape, shape.number == number)
        query = query.join(judgement, (judgement.shape_number == number) & same_search[0] & same_search[1])
    query = (
        query.join(CollectionRow, CollectionRow.number == first.collection_number)
        .where(or_(pair.first_number.in_(shapes), pair.second_number.in_(shapes)))
        .where(later > told, later <= last)
        .order_by(pair.first_number, pair.second_number)
    )
    items = [
        {"collection": name, "shapes": [_named(one), _named(other)], "variant": variant}
        for name, one, other, variant in session.execute(query)
    ]
    return last, items


def _ended(session: WriteSession, told: int, _until: int) -> Items:
    """Return the jobs that have ended since the last message, and count them as told."""
    jobs = session.execute(
        select(JobRow, CollectionRow.name)
        .join(CollectionRow, CollectionRow.number == JobRow.collection_number)
        .where(_UNTOLD)
        .order_by(JobRow.number)
        .limit(MOST)
    ).all()
    numbers = [job.number for job, _ in jobs]
    session.execute(update(JobRow).where(JobRow.number.in_(numbers)).values(told=True))
    return told, [
        {"collection": name, "id": job.id, "archive": job.archive, "state": job.state} for job, name in jobs
    ]


_UNTOLD = JobRow.state.in_(ENDED) & JobRow.told.is_(False)

KINDS: dict[str, tuple[Select[int | None], Callable[[WriteSession, int, int], Items]]] = {
    "shapes.stored": (select(func.max(ShapeRow.number)), _stored),
    "duplicates.found": (select(func.max(JudgedShapeRow.number)), _duplicates),
    # Jobs do not end in the order of their numbers: each is marked when it is told.
    "jobs.ended": (select(func.count()).select_from(JobRow).where(_UNTOLD), _ended),
}
"""The kinds of messages: the number of the latest row to tell of, and what a message tells of rows.

The function takes the numbers of the last row that was told and of the last one to tell, and returns that of
the last row that the message tells of.
"""
