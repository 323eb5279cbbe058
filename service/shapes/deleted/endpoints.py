"""Deleting shapes, and the addresses of those that were deleted."""

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Query, Request
from pydantic import ConfigDict, Field

from service.collections.dependencies import InCollection, NamedInAddress
from service.dependencies import Service
from service.http.middleware import while_connected
from service.http.problems import documented
from service.http.request_bodies import once, once_each
from service.pipelines.active import fingerprint
from service.shapes.deleted import service
from service.shapes.deleted.schemas import DeletedShapePage
from service.shapes.documentation import FILE_PROBLEMS, READ_PROBLEMS, WRITE_PROBLEMS
from service.shapes.endpoints import ShapeId
from service.shapes.pages import read_cursor
from service.shapes.schemas import Shape

router = APIRouter(tags=["shapes"])


class DeletedListing(NamedInAddress):
    """A page of deleted shapes."""

    model_config = ConfigDict(extra="forbid")

    cursor: str | None = Field(
        default=None, max_length=256, description="The `next_cursor` of the previous page."
    )
    limit: int = Field(default=50, ge=1, le=500, description="The largest number of shapes of the page.")


@router.delete(
    "/shapes/{shape_id}",
    status_code=204,
    summary="Delete a shape",
    responses=documented("bad-request-fields", "shape-not-found", *WRITE_PROBLEMS),
    dependencies=[once("permanent")],
)
def delete_shape(
    shape_id: ShapeId,
    container: Service,
    collection: InCollection,
    permanent: Annotated[
        bool, Query(description="Delete for good, which frees the room of the file at once.")
    ] = False,
) -> None:
    """Delete the record, and its file and embedding unless another shape has the same bytes.

    Unless `permanent`, the shape can be restored for as long as the service is set to keep deleted shapes.
    """
    keep = timedelta(0) if permanent else container.settings.undo_time
    with container.database.write(deleting=True) as session:
        service.delete(session, fingerprint(session), collection.number, shape_id, keep)


@router.post(
    "/shapes/{shape_id}/restore",
    summary="Restore a deleted shape",
    responses=documented(
        *(kind for kind in FILE_PROBLEMS if kind not in {"bad-request", "body-too-large"}),
        "shape-not-found",
        "name-taken",
        "pipeline-unavailable",
        *WRITE_PROBLEMS,
    ),
)
async def restore_shape(
    shape_id: ShapeId, request: Request, container: Service, collection: InCollection
) -> Shape:
    """Undo a deletion: the shape has its id, name, tags and metadata again, and is listed last."""
    with container.queue.admitted():
        work = service.restore(container, collection.number, shape_id)
        return Shape.of(await while_connected(request, work))


@router.get(
    "/deleted",
    summary="List deleted shapes",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(DeletedListing)],
)
def list_deleted(
    listing: Annotated[DeletedListing, Query()], container: Service, collection: InCollection
) -> DeletedShapePage:
    """The shapes that can be restored, those deleted first before the others, a page at a time."""
    after, keep = read_cursor(listing.cursor), container.settings.undo_time
    with container.database.read() as session:
        page = service.list_page(session, collection.number, keep, after=after, limit=listing.limit)
    return DeletedShapePage.of(page, keep)


@router.delete(
    "/deleted/{shape_id}",
    status_code=204,
    summary="Purge a deleted shape",
    responses=documented("shape-not-found", *WRITE_PROBLEMS),
)
def purge_shape(shape_id: ShapeId, container: Service, collection: InCollection) -> None:
    """Forget a deleted shape and its file now, for good."""
    with container.database.write(deleting=True) as session:
        service.purge(session, collection.number, shape_id, container.settings.undo_time)
