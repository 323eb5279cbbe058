"""The SQL of merges of near-identical shapes."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sqlalchemy import delete, func, select

from service.collection import CollectionNumber
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import DuplicateMergeRow, ShapeRow


class Merge(NamedTuple):
    """A merged group: the id of the shape that stayed, its file, tags and metadata then, the deleted ids."""

    shape: str
    sha256: str
    tags: Sequence[str]
    metadata: Mapping[str, Any]
    deleted: list[str]


def add(session: WriteSession, collection: CollectionNumber, act: str, merge: Merge) -> None:
    """Store the merge of a group."""
    session.add(
        DuplicateMergeRow(
            id=act,
            collection_number=collection,
            shape=merge.shape,
            sha256=merge.sha256,
            tags=list(merge.tags),
            meta=dict(merge.metadata),
            deleted=merge.deleted,
            merged_at=datetime.now(UTC),
        )
    )


def of_id(
    session: ReadSession, collection: CollectionNumber, act: str, *, after: int, limit: int
) -> list[tuple[int, Merge]]:
    """Return the next groups of a merge, by number."""
    row = DuplicateMergeRow
    query = select(row).where(row.collection_number == collection, row.id == act, row.number > after)
    rows = session.scalars(query.order_by(row.number).limit(limit))
    return [
        (each.number, Merge(each.shape, each.sha256, each.tags, each.meta, each.deleted)) for each in rows
    ]


def latest(session: ReadSession, collection: CollectionNumber, shapes: Sequence[str]) -> dict[str, int]:
    """Return the number of the latest merge of each of some shapes that stayed."""
    row = DuplicateMergeRow
    query = select(row.shape, func.max(row.number)).where(row.collection_number == collection)
    return dict(session.execute(query.where(row.shape.in_(shapes)).group_by(row.shape)).all())


def page(
    session: ReadSession, collection: CollectionNumber, *, after: int, limit: int
) -> Sequence[DuplicateMergeRow]:
    """Return the next `limit` merged groups of a collection, the oldest first."""
    row = DuplicateMergeRow
    query = select(row).where(row.collection_number == collection, row.number > after)
    return session.scalars(query.order_by(row.number).limit(limit)).all()


def latest_acts(
    session: ReadSession, collection: CollectionNumber, *, limit: int
) -> list[tuple[int, DuplicateMergeRow, list[str]]]:
    """Return the number of groups of each of the latest merges, the first of them, and the names in it."""
    row = DuplicateMergeRow
    acts = select(func.min(row.number), func.count()).where(row.collection_number == collection)
    acts = acts.group_by(row.id).order_by(func.max(row.number).desc()).limit(limit)
    groups = dict(session.execute(acts).all())
    rows = {each.number: each for each in session.scalars(select(row).where(row.number.in_(list(groups))))}
    shapes = {each.number: [each.shape, *each.deleted] for each in rows.values()}
    wanted = [shape for group in shapes.values() for shape in group]
    names = dict(session.execute(select(ShapeRow.id, ShapeRow.name).where(ShapeRow.id.in_(wanted))).all())
    return [
        (many, rows[number], [names[shape] for shape in shapes[number] if shape in names])
        for number, many in groups.items()
    ]


def count(session: ReadSession, collection: CollectionNumber) -> int:
    """Return the number of the merged groups of a collection."""
    row = DuplicateMergeRow
    return session.scalar(select(func.count()).where(row.collection_number == collection)) or 0


def remove(session: WriteSession, number: int) -> None:
    """Delete the merge of a group."""
    session.execute(delete(DuplicateMergeRow).where(DuplicateMergeRow.number == number))
