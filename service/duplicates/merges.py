"""Merges of near-identical shapes, by hand and by a rule, and what undoes them."""

import uuid
from collections.abc import Mapping, Sequence
from datetime import timedelta
from itertools import combinations
from typing import Any

from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import decision_repository, merge_repository
from service.duplicates.decision_schemas import (
    MOST_LEFT,
    Decided,
    LeftGroup,
    MergedGroup,
    MergedShape,
    MergePage,
    Undone,
)
from service.duplicates.merge_repository import Merge
from service.duplicates.records import Decision, Pair, pair_of
from service.errors import BadRequestFieldsError, FieldFault, MissingError, NameTakenError, ShapeNotFoundError
from service.shapes import repository as shapes_repository
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord
from service.shapes.schemas import Shape, ShapeChanges, write_cursor
from service.storage.database import ReadSession, WriteSession

AT_ONCE = 100
"""Groups that one transaction merges, and that one statement reads."""


class MergeNotFoundError(MissingError, kind="merge-not-found"):
    """The collection has no merge with the id that can be undone."""


def merge(
    session: WriteSession, collection: CollectionNumber, shapes: Sequence[str], keep: str, undo: timedelta
) -> MergedShape:
    """Merge some shapes; see `_merged`.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    BadRequestFieldsError
        None of the shapes has the id `keep`, or all together have more tags or metadata than one may have.
    """
    records = [shapes_service.get(session, collection, each) for each in shapes]
    act = _new_id(undo)
    return MergedShape(shape=Shape.of(_merged(session, collection, records, keep, undo, act)), id=act)


def _new_id(undo: timedelta) -> str | None:
    """Return the id of a merge, None if it cannot be undone."""
    return str(uuid.uuid4()) if undo else None


def _merged(
    session: WriteSession,
    collection: CollectionNumber,
    shapes: Sequence[ShapeRecord],
    keep: str,
    undo: timedelta,
    act: str | None,
) -> ShapeRecord:
    """Give one shape the tags and the metadata of all, and delete the others, restorable for the time `undo`.

    The metadata of the shape that stays override those of the others, and older ones override newer ones. A
    merge is checked before it changes anything.
    """
    records = sorted(shapes, key=lambda record: record.number)
    kept = _kept(records, keep)
    others = [record for record in records if record is not kept]
    changes = ShapeChanges(**_joined(kept, others))
    for record in others:
        shapes_service.delete(session, collection, record.id, undo)
    if act is not None:
        deleted = [record.id for record in others]
        row = Merge(kept.id, kept.sha256, kept.tags, kept.metadata, deleted)
        merge_repository.add(session, collection, act, row)
    return shapes_service.change(session, collection, kept.id, changes, collection)


async def merge_groups(
    container: Container, collection: CollectionNumber, groups: Sequence[Sequence[str]], keep: str
) -> Decided:
    """Merge groups of shapes, by their ids, under one id.

    A group is left if two of its shapes are decided to differ, if all have more tags or metadata together
    than one may have, or if a shape is deleted meanwhile. A transaction merges `AT_ONCE` groups.
    """
    undo = container.settings.undo_time
    act = _new_id(undo)
    merged: list[int] = []
    left: list[LeftGroup] = []

    def merge_some(session: WriteSession, some: Sequence[Sequence[str]]) -> tuple[list[int], list[LeftGroup]]:
        sizes: list[int] = []
        unmerged: list[LeftGroup] = []
        decided = decision_repository.decided(session, collection)
        for ids in some:
            try:
                records = [shapes_service.get(session, collection, each) for each in ids]
                if _differ(records, decided):
                    unmerged.append(
                        LeftGroup(shapes=list(ids), reason="two of its shapes are decided to differ")
                    )
                    continue
                _merged(session, collection, records, keep, undo, act)
                sizes.append(len(ids))
            except (BadRequestFieldsError, ShapeNotFoundError) as error:
                unmerged.append(LeftGroup(shapes=list(ids), reason=str(error)))
        return sizes, unmerged

    for start in range(0, len(groups), AT_ONCE):
        some = await container.database.writing(merge_some, groups[start : start + AT_ONCE])
        merged += some[0]
        left += some[1]
    pairs = sum(size * (size - 1) // 2 for size in merged)
    return Decided(id=act if merged else None, groups=len(merged), pairs=pairs, left=left[:MOST_LEFT])


def _differ(shapes: Sequence[ShapeRecord], decided: Mapping[Pair, Decision]) -> bool:
    """Return whether two of some shapes are decided to differ."""
    pairs = combinations([shape.sha256 for shape in shapes], 2)
    return any(decided.get(pair_of(*pair)) == "different" for pair in pairs)


async def undo(container: Container, collection: CollectionNumber, act: str) -> Undone:
    """Restore the shapes that a merge deleted, and give those that stayed their former tags and metadata.

    A group is left if one of its shapes is gone, if the file of a deleted shape was stored again under its
    name, or if the shape that stayed was merged again: the tags of that merge would come back. A call that
    fails can be repeated: it goes on with the groups that are not restored.

    Raises
    ------
    MergeNotFoundError
        The collection has no such merge, or all of it is undone.
    """
    reading = container.database.reading
    after, groups = 0, 0
    left: list[LeftGroup] = []
    while rows := await reading(merge_repository.of_id, collection, act, after=after, limit=AT_ONCE):
        latest = await reading(merge_repository.latest, collection, [row.shape for _, row in rows])
        for number, row in rows:
            if latest.get(row.shape, number) > number:
                again = f"{row.shape} was merged again later: undo that merge first"
                left.append(LeftGroup(shapes=[row.shape, *row.deleted], reason=again))
                continue
            try:
                await _undo(container, collection, number, row)
                groups += 1
            except (NameTakenError, ShapeNotFoundError) as error:
                left.append(LeftGroup(shapes=[row.shape, *row.deleted], reason=str(error)))
        after = rows[-1][0]
    if not after:
        raise MergeNotFoundError(act)
    return Undone(groups=groups, left=left[:MOST_LEFT])


async def _undo(container: Container, collection: CollectionNumber, number: int, merged: Merge) -> None:
    """Undo the merge of one group. Shapes that are there again are left alone."""

    def missing(session: ReadSession) -> list[str]:
        shapes_service.get(session, collection, merged.shape)
        return [each for each in merged.deleted if shapes_repository.by_id(session, collection, each) is None]

    def end(session: WriteSession) -> None:
        former = ShapeChanges(tags=list(merged.tags), metadata=dict(merged.metadata))
        shapes_service.change(session, collection, merged.shape, former, collection)
        merge_repository.remove(session, number)

    for shape_id in await container.database.reading(missing):
        await shapes_service.restore(container, collection, shape_id)
    await container.database.writing(end)


def list_merges(session: ReadSession, collection: CollectionNumber, *, after: int, limit: int) -> MergePage:
    """Return one page of the merged groups of a collection, the oldest merge first."""
    rows = merge_repository.page(session, collection, after=after, limit=limit + 1)
    return MergePage(
        merges=[
            MergedGroup(id=row.id, shape=row.shape, deleted=row.deleted, merged_at=row.merged_at)
            for row in rows[:limit]
        ],
        total=merge_repository.count(session, collection),
        next_cursor=write_cursor(rows[limit - 1].number) if len(rows) > limit else None,
    )


def _kept(records: Sequence[ShapeRecord], keep: str) -> ShapeRecord:
    """Return the one of some shapes, the oldest first, that a merge keeps."""
    if keep in {"oldest", "newest"}:
        return records[0 if keep == "oldest" else -1]
    if keep == "largest":
        return max(records, key=lambda record: record.facts["faces"])
    for record in records:
        if record.id == keep:
            return record
    raise BadRequestFieldsError(
        FieldFault("keep", "must be oldest, newest, largest or the id of one of the shapes")
    )


def _joined(kept: ShapeRecord, others: Sequence[ShapeRecord]) -> Mapping[str, Any]:
    """Return the fields of a shape that it gets from others, if any."""
    metadata = dict(kept.metadata)
    for record in others:
        metadata |= {key: value for key, value in record.metadata.items() if key not in metadata}
    tags = [*kept.tags, *(tag for record in others for tag in record.tags)]
    return shapes_service.changed_fields(kept, tags, metadata)
