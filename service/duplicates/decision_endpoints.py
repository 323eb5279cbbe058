"""The addresses /duplicates/decisions, /duplicates/merge and /duplicates/rule."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from service.collections.endpoints import InCollection
from service.container import Service
from service.duplicates import decisions
from service.duplicates.decision_schemas import (
    Decided,
    DecisionPage,
    GroupDecision,
    Merge,
    MergedShape,
    MergeUndo,
    Rule,
)
from service.duplicates.endpoints import JUDGING_PROBLEMS
from service.http.middleware import KEY_IN_SCOPE, while_connected
from service.http.problems import READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import once_each
from service.pipelines.active import ActivePipeline
from service.search.answer import with_active_pipeline
from service.shapes.endpoints import RESTORE_PROBLEMS, PageOptions
from service.shapes.fields import Id
from service.shapes.schemas import Shape, read_cursor

router = APIRouter(tags=["search"])

DecisionId = Annotated[Id, Path(description="The id of a decision.")]


def _who(request: Request, named: str | None) -> str | None:
    """Return who decides: the person named, or the first digits of the key's digest."""
    return named or request.scope.get(KEY_IN_SCOPE, "")[:8] or None


@router.post(
    "/duplicates/decisions",
    status_code=201,
    summary="Decide near-identical shapes",
    responses=documented("shape-not-found", *WRITE_PROBLEMS),
)
def decide(wanted: GroupDecision, request: Request, container: Service, collection: InCollection) -> Decided:
    """Store what every pair of some shapes is. GET /duplicates does not show these pairs again.

    A decision belongs to the files: it holds under other names, after a deletion and for other pipelines, and
    no longer when a file is replaced. It takes the place of an earlier decision.
    """
    with container.database.write() as session:
        return decisions.decide(session, collection.number, wanted, _who(request, wanted.decided_by))


@router.get(
    "/duplicates/decisions",
    summary="List decisions",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(PageOptions)],
)
def list_decisions(
    listing: Annotated[PageOptions, Query()], container: Service, collection: InCollection
) -> DecisionPage:
    """Return the decided pairs, the oldest decision first, a page at a time."""
    with container.database.read() as session:
        after = read_cursor(listing.cursor)
        return decisions.list_decisions(session, collection.number, after=after, limit=listing.limit)


@router.delete(
    "/duplicates/decisions/{decision_id}",
    status_code=204,
    summary="Undo a decision",
    responses=documented("decision-not-found", *WRITE_PROBLEMS),
)
def delete_decision(decision_id: DecisionId, container: Service, collection: InCollection) -> None:
    """Delete a decision on all its pairs, which are shown as duplicates again."""
    with container.database.write(deleting=True) as session:
        decisions.remove(session, collection.number, decision_id)


@router.post(
    "/duplicates/merge",
    summary="Merge shapes",
    responses=documented("shape-not-found", *WRITE_PROBLEMS),
)
def merge(wanted: Merge, container: Service, collection: InCollection) -> MergedShape:
    """Give one shape the tags and metadata of all, and delete the others.

    Its own metadata override those of the others. Deleted shapes can be restored for ISOSHAPE_UNDO_DAYS.
    """
    with container.database.write() as session:
        undo = container.settings.undo_time
        return decisions.merge(session, collection.number, wanted.shapes, wanted.keep, undo)


@router.post(
    "/duplicates/merge/undo",
    summary="Undo a merge",
    responses=documented(*RESTORE_PROBLEMS),
)
async def undo_merge(
    wanted: MergeUndo, request: Request, container: Service, collection: InCollection
) -> Shape:
    """Restore the shapes that a merge deleted, and give the one that stayed its former tags and metadata.

    The call can be repeated if it fails.
    """
    async with container.queue.admitted(request):
        undone = decisions.undo_merge(container, collection.number, wanted)
        return Shape.of(await while_connected(request, undone))


@router.post(
    "/duplicates/rule",
    summary="Decide or merge by a rule",
    responses=documented(*JUDGING_PROBLEMS, *WRITE_PROBLEMS),
)
async def apply_rule(rule: Rule, request: Request, container: Service, collection: InCollection) -> Decided:
    """Decide, or merge, all groups of GET /duplicates that meet a rule. A dry run counts them.

    A group is `left` if two of its shapes are decided to differ, or if all have more tags or metadata
    together than a shape may have. The others are merged, and each of `merges` can be undone. A call that
    fails may have merged some groups; the same call goes on with the others.
    """

    async def apply(active_pipeline: ActivePipeline) -> Decided:
        who = _who(request, rule.decided_by)
        return await decisions.apply_rule(container, collection.number, rule, who, active_pipeline)

    async with container.queue.admitted(request):
        return await while_connected(request, with_active_pipeline(container, apply))
