"""Decisions on near-identical shapes: decide a group, and decide or merge all groups that meet a rule."""

from collections.abc import Sequence
from itertools import combinations

from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import decision_repository, merge_repository, merges, service
from service.duplicates.decision_schemas import Act, Acts, Decided, DecisionPage, GroupDecision, Rule
from service.duplicates.groups import Counted, Search
from service.duplicates.records import Decision, pair_of
from service.errors import MissingError
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.shapes import service as shapes_service
from service.shapes.records import ShapeFilter
from service.shapes.schemas import write_cursor
from service.storage.database import ReadSession, WriteSession


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


def list_acts(session: ReadSession, collection: CollectionNumber, *, limit: int) -> Acts:
    """Return the latest decisions and merges of a collection that can be undone, the latest first."""
    acts = [
        Act(
            id=pair.id,
            action=pair.decision,
            decided_by=pair.decided_by,
            reason=pair.reason,
            decided_at=pair.decided_at,
            count=pairs,
            names=sorted({**pair.first.shapes, **pair.second.shapes}.values()),
        )
        for pairs, pair in decision_repository.latest(session, collection, limit=limit)
    ]
    acts += [
        Act(id=row.id, action="merge", decided_at=row.merged_at, count=groups, names=names)
        for groups, row, names in merge_repository.latest_acts(session, collection, limit=limit)
    ]
    return Acts(acts=sorted(acts, key=lambda act: act.decided_at, reverse=True)[:limit])


def remove(session: WriteSession, collection: CollectionNumber, decision_id: str) -> None:
    """Delete a decision.

    Raises
    ------
    DecisionNotFoundError
    """
    if not decision_repository.remove(session, collection, decision_id):
        raise DecisionNotFoundError(decision_id)


async def apply_rule(
    container: Container,
    wanted: ShapeFilter,
    rule: Rule,
    decided_by: str | None,
    active_pipeline: ActivePipeline,
) -> Decided:
    """Decide all groups that meet a rule, in one act, or merge them; a dry run counts them.

    A merge that fails can be undone by its id; the same rule goes on with the other groups.
    """
    bounds = Search(active_pipeline.fingerprint, rule.variants)
    counted = Counted(rule.scaled, rule.mirrored)
    collection = wanted.collection
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

    return await merges.merge_groups(
        container, collection, [[shape.id for shape in group] for group in groups], rule.keep
    )
