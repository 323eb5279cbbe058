"""The addresses /duplicates/decisions, /duplicates/merge, /duplicates/merges and /duplicates/rule."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request
from pydantic import Field

from service.collections.endpoints import InCollection, NamedInAddress
from service.container import Service
from service.duplicates import decisions, merges
from service.duplicates.decision_schemas import (
    Acts,
    Decided,
    DecisionPage,
    GroupDecision,
    Merge,
    MergedShape,
    MergePage,
    Rule,
    Undone,
)
from service.duplicates.endpoints import JUDGING_PROBLEMS
from service.http.middleware import KEY_IN_SCOPE, while_connected
from service.http.problems import READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import once_each
from service.pipelines.active import ActivePipeline
from service.search.answer import with_active_pipeline
from service.shapes.endpoints import RESTORE_PROBLEMS, PageOptions
from service.shapes.fields import Id
from service.shapes.schemas import read_cursor

router = APIRouter(tags=["search"])

DecisionId = Annotated[Id, Path(description="The id of a decision.")]
MergeId = Annotated[Id, Path(description="The id of a merge.")]


class ActOptions(NamedInAddress):
    """The length of a list of acts."""

    limit: int = Field(default=50, ge=1, le=500, description="The largest number of acts.")


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
    "/duplicates/merge", summary="Merge shapes", responses=documented("shape-not-found", *WRITE_PROBLEMS)
)
def merge(wanted: Merge, container: Service, collection: InCollection) -> MergedShape:
    """Give one shape the tags and metadata of all, and delete the others.

    Its own metadata override those of the others. Deleted shapes can be restored for ISOSHAPE_UNDO_DAYS.
    """
    with container.database.write() as session:
        undo = container.settings.undo_time
        return merges.merge(session, collection.number, wanted.shapes, wanted.keep, undo)


@router.get(
    "/duplicates/merges",
    summary="List merges",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(PageOptions)],
)
def list_merges(
    listing: Annotated[PageOptions, Query()], container: Service, collection: InCollection
) -> MergePage:
    """Return the merged groups that can be undone, the oldest merge first, a page at a time."""
    with container.database.read() as session:
        after = read_cursor(listing.cursor)
        return merges.list_merges(session, collection.number, after=after, limit=listing.limit)


@router.post(
    "/duplicates/merges/{merge_id}/undo",
    summary="Undo a merge",
    responses=documented("merge-not-found", *RESTORE_PROBLEMS),
)
async def undo_merge(
    merge_id: MergeId, request: Request, container: Service, collection: InCollection
) -> Undone:
    """Restore all shapes that a merge deleted, and give those that stayed their former tags and metadata.

    A group is `left` if one of its shapes is gone or its name taken, or if the shape that stayed was merged
    again later. A call that fails can be repeated.
    """
    async with container.queue.admitted(request):
        return await while_connected(request, merges.undo(container, collection.number, merge_id))


@router.get(
    "/duplicates/acts",
    summary="List what can be undone",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(ActOptions)],
)
def list_acts(listing: Annotated[ActOptions, Query()], container: Service, collection: InCollection) -> Acts:
    """Return the latest decisions and merges that can be undone, the latest first, each as one act."""
    with container.database.read() as session:
        return decisions.list_acts(session, collection.number, limit=listing.limit)


@router.post(
    "/duplicates/rule",
    summary="Decide or merge by a rule",
    responses=documented(*JUDGING_PROBLEMS, *WRITE_PROBLEMS),
)
async def apply_rule(rule: Rule, request: Request, container: Service, collection: InCollection) -> Decided:
    """Decide, or merge, all groups of GET /duplicates that meet a rule. A dry run counts them.

    A group is `left` if two of its shapes are decided to differ, or if all have more tags or metadata
    together than a shape may have. The others are merged, and one call undoes all of it. A call that fails
    may have merged some groups, which GET /duplicates/merges has; the same call goes on with the others.
    """
    wanted, who = rule.filtered(collection), _who(request, rule.decided_by)

    async def apply(active_pipeline: ActivePipeline) -> Decided:
        return await decisions.apply_rule(container, wanted, rule, who, active_pipeline)

    async with container.queue.admitted(request):
        return await while_connected(request, with_active_pipeline(container, apply))
