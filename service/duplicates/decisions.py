"""Decisions on near-identical shapes: decide, merge, and do either with all groups that meet a rule."""

from collections.abc import Mapping, Sequence
from datetime import timedelta
from itertools import combinations
from typing import Any

from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import decision_repository, service
from service.duplicates.decision_schemas import (
    Decided,
    DecisionPage,
    GroupDecision,
    LeftGroup,
    MergedShape,
    MergeUndo,
    Rule,
)
from service.duplicates.groups import Counted, Search
from service.duplicates.records import Decision, pair_of
from service.errors import BadRequestFieldsError, FieldFault, MissingError, ShapeNotFoundError
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.shapes import repository as shapes_repository
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord
from service.shapes.schemas import Shape, ShapeChanges, write_cursor
from service.storage.database import ReadSession, WriteSession

MERGED = 100
"""Groups that one transaction merges by a rule."""


class DecisionNotFoundError(MissingError, kind="decision-not-found"):
    """The collection has no decision with the id."""


def decide(
    session: WriteSession, collection: CollectionNumber, wanted: GroupDecision, decided_by: str | None
) -> Decided:
    """Decide every pair of some shapes.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    files = [shapes_service.get(session, collection, each).sha256 for each in wanted.shapes]
    return _store(session, collection, [files], wanted.decision, decided_by, wanted.reason)


def _store(
    session: WriteSession,
    collection: CollectionNumber,
    groups: Sequence[Sequence[str]],
    decision: Decision,
    decided_by: str | None,
    reason: str,
) -> Decided:
    """Decide every pair of files of each group, in one act."""
    pairs = {pair_of(first, second) for group in groups for first, second in combinations(group, 2)}
    act = decision_repository.decide(session, collection, pairs, decision, decided_by, reason)
    return Decided(id=act, groups=len(groups), pairs=len(pairs))


def list_decisions(
    session: ReadSession, collection: CollectionNumber, *, after: int, limit: int
) -> DecisionPage:
    """Return one page of the decided pairs of a collection."""
    rows = decision_repository.page(session, collection, after=after, limit=limit + 1)
    return DecisionPage(
        decisions=[decided for _, decided in rows[:limit]],
        total=decision_repository.count(session, collection),
        next_cursor=write_cursor(rows[limit - 1][0]) if len(rows) > limit else None,
    )


def remove(session: WriteSession, collection: CollectionNumber, decision_id: str) -> None:
    """Delete a decision.

    Raises
    ------
    DecisionNotFoundError
    """
    if not decision_repository.remove(session, collection, decision_id):
        raise DecisionNotFoundError(decision_id)


def merge(
    session: WriteSession, collection: CollectionNumber, shapes: Sequence[str], keep: str, undo: timedelta
) -> MergedShape:
    """Give one shape the tags and the metadata of all, and delete the others, restorable for the time `undo`.

    The metadata of the shape that stays override those of the others, and older ones override newer ones.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    BadRequestFieldsError
        None of the shapes has the id `keep`, or all together have more tags or metadata than one may have.
    """
    records = sorted(
        (shapes_service.get(session, collection, each) for each in shapes), key=lambda record: record.number
    )
    kept = _kept(records, keep)
    others = [record for record in records if record is not kept]
    changes = ShapeChanges(**_joined(kept, others))
    for record in others:
        shapes_service.delete(session, collection, record.id, undo)
    after = shapes_service.change(session, collection, kept.id, changes, collection)
    deleted = [record.id for record in others]
    former = MergeUndo(shape=kept.id, tags=list(kept.tags), metadata=dict(kept.metadata), deleted=deleted)
    return MergedShape(shape=Shape.of(after), undo=former)


async def undo_merge(container: Container, collection: CollectionNumber, wanted: MergeUndo) -> ShapeRecord:
    """Restore the shapes that a merge deleted, and give the one that stayed its former tags and metadata.

    A call that failed after some shapes can be repeated: shapes that are there again are left alone.

    Raises
    ------
    ShapeNotFoundError
        A shape is neither there nor to be restored.
    NameTakenError
        The file of a deleted shape was stored again under its name.
    """

    def is_there(session: ReadSession, shape_id: str) -> bool:
        return shapes_repository.by_id(session, collection, shape_id) is not None

    await container.database.reading(shapes_service.get, collection, wanted.shape)
    for shape_id in wanted.deleted:
        if not await container.database.reading(is_there, shape_id):
            await shapes_service.restore(container, collection, shape_id)
    former = ShapeChanges(tags=wanted.tags, metadata=wanted.metadata)
    return await container.database.writing(
        shapes_service.change, collection, wanted.shape, former, collection
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


async def apply_rule(
    container: Container,
    collection: CollectionNumber,
    rule: Rule,
    decided_by: str | None,
    active_pipeline: ActivePipeline,
) -> Decided:
    """Decide all groups that meet a rule, in one act, or merge them; a dry run counts them.

    A group is left if two of its shapes are decided to differ, if all have more tags or metadata together
    than one may have, or if a shape is deleted meanwhile. A transaction merges `MERGED` groups. If one fails,
    the same rule goes on with the others.
    """
    bounds = Search(active_pipeline.fingerprint, rule.variants)
    counted = Counted(rule.scaled, rule.mirrored)
    wanted = rule.filtered(collection)
    answer = await service.find(container, wanted, bounds, counted, active_pipeline, Timings())
    groups = [
        [duplicate.shape for duplicate in group]
        for group in answer.groups
        if all(duplicate.likeness in rule.likeness for duplicate in group)
    ]
    pairs = sum(len(group) * (len(group) - 1) // 2 for group in groups)
    if rule.dry_run or not groups:
        return Decided(id=None, groups=len(groups), pairs=pairs)

    if rule.action != "merge":
        files = [[shape.sha256 for shape in group] for group in groups]
        decided = files, rule.action, decided_by, rule.reason
        return await container.database.writing(_store, collection, *decided)

    def merge_some(
        session: WriteSession, some: Sequence[Sequence[Shape]]
    ) -> tuple[list[MergeUndo], list[LeftGroup]]:
        undos: list[MergeUndo] = []
        left: list[LeftGroup] = []
        decided = decision_repository.decided(session, collection)
        for group in some:
            ids = [shape.id for shape in group]
            files = combinations([shape.sha256 for shape in group], 2)
            if any(decided.get(pair_of(*pair)) == "different" for pair in files):
                left.append(LeftGroup(shapes=ids, reason="two of its shapes are decided to differ"))
                continue
            try:
                undos.append(merge(session, collection, ids, rule.keep, container.settings.undo_time).undo)
            except (BadRequestFieldsError, ShapeNotFoundError) as error:
                # A merge is checked before it changes anything.
                left.append(LeftGroup(shapes=ids, reason=str(error)))
        return undos, left

    merges: list[MergeUndo] = []
    left: list[LeftGroup] = []
    for start in range(0, len(groups), MERGED):
        some = await container.database.writing(merge_some, groups[start : start + MERGED])
        merges += some[0]
        left += some[1]
    sizes = [1 + len(undo.deleted) for undo in merges]
    pairs = sum(size * (size - 1) // 2 for size in sizes)
    return Decided(id=None, groups=len(merges), pairs=pairs, merges=merges, left=left)
