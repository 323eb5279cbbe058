"""The addresses of pictures: thumbnails and previews of stored shapes, and the preview of a file."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response

from core.io import format_of
from service.collection import DEFAULT_COLLECTION, CollectionNumber
from service.collections.endpoints import InCollection
from service.container import Container, Service
from service.http.middleware import while_connected
from service.http.problems import FILE_PROBLEMS, READ_PROBLEMS, WORKER_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once
from service.previews.thumbnails import draw_stored, store
from service.rendering import tasks
from service.rendering.tasks import FACES, MEDIA_TYPE
from service.rendering.thumbnail import DRAWING
from service.shapes import file_repository
from service.shapes import service as shapes_service
from service.shapes.endpoints import MeshUpload, ShapeId
from service.shapes.fields import Id
from service.shapes.file_endpoints import is_known
from service.shapes.records import ShapeRecord
from service.web.endpoints import page, viewing_page

router = APIRouter(tags=["shapes"])

MESH = RequestBody(MeshUpload)

WORK_PROBLEMS = (*READ_PROBLEMS, *WORKER_PROBLEMS, "shape-not-found", "file-in-place")
GLB: dict[str, Any] = {
    "description": f"A GLB of at most about {FACES} faces.",
    "content": {MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}}},
}
KNOWN: dict[int | str, dict[str, Any]] = {
    304: {"description": "The client has it already: its If-None-Match has the ETag."}
}


@router.get(
    "/shapes/{shape_id}/thumbnail.png",
    summary="Get a picture",
    response_class=Response,
    dependencies=[once("size")],
    responses={
        200: {
            "description": "A picture on a transparent background.",
            "content": {"image/png": {"schema": {"type": "string", "contentMediaType": "image/png"}}},
        },
        **KNOWN,
        **documented(*WORK_PROBLEMS),
    },
)
async def read_thumbnail(
    shape_id: ShapeId,
    request: Request,
    container: Service,
    collection: InCollection,
    size: Annotated[
        Literal["64", "128", "256", "512"], Query(description="Width and height in pixels.")
    ] = "256",
) -> Response:
    """Return a picture of the shape, which is drawn once a size. z points up, in OBJ and GLB files y."""
    shape = await container.database.reading(shapes_service.get, collection.number, shape_id)
    headers = validated(f"{shape.sha256[:32]}-{shape.format}-{size}-{DRAWING}")
    if is_known(request.headers.get("If-None-Match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    data = await _thumbnail(request, container, collection.number, shape, int(size))
    return Response(data, media_type="image/png", headers=headers)


@router.get(
    "/shapes/{shape_id}/preview.glb",
    summary="Get a preview of a shape",
    response_class=Response,
    responses={200: GLB, **KNOWN, **documented(*WORK_PROBLEMS)},
)
async def read_preview(
    shape_id: ShapeId, request: Request, container: Service, collection: InCollection
) -> Response:
    """Return the mesh for a viewer: a GLB for every format, simplified if the mesh is large, with y up.

    Positions are between -1 and 1: a point p of the file becomes (p - middle) / half, and the `extras` of the
    node have `middle` and `half`.
    """
    shape = await container.database.reading(shapes_service.get, collection.number, shape_id)
    headers = validated(f"{shape.sha256[:32]}-{shape.format}-{FACES}-preview-1")
    if is_known(request.headers.get("If-None-Match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    async with container.queue.admitted(request):
        data = await container.database.reading(file_repository.file_of, collection.number, shape_id)
        glb = await while_connected(request, _preview(container, data, shape.format))
    return Response(glb, media_type=MEDIA_TYPE, headers=headers)


@router.post(
    "/preview",
    summary="Get a preview of a file, without storing it",
    response_class=Response,
    responses={200: GLB, **documented(*FILE_PROBLEMS, "storage-full")},
    openapi_extra=MESH.openapi,
)
async def make_preview(
    request: Request, container: Service, upload: Annotated[MeshUpload, Depends(MESH, scope="function")]
) -> Response:
    """Return the preview of a file that is not stored: a page shows it beside the answer to a query."""
    mesh_format = format_of(upload.file.filename or "")
    async with container.queue.admitted(request):
        data = await upload.file.read()
        glb = await while_connected(request, _preview(container, data, mesh_format))
    return Response(glb, media_type=MEDIA_TYPE)


@router.get(
    "/shapes/{shape_id}/view",
    summary="View a shape",
    response_class=Response,
    dependencies=[once("beside")],
    responses={
        200: {"description": "A page.", "content": {"text/html": {"schema": {"type": "string"}}}},
        **documented("shape-not-found", *READ_PROBLEMS),
    },
)
def view_shape(
    shape_id: ShapeId,
    request: Request,
    container: Service,
    collection: InCollection,
    beside: Annotated[
        Id | None, Query(description="A second shape: their corresponding points, and landmarks of both.")
    ] = None,
) -> Response:
    """Return a page that shows the shape in 3D, alone or beside another one."""
    with container.database.read() as session:
        for shown in filter(None, (shape_id, beside)):
            shapes_service.get(session, collection.number, shown)
    if collection == DEFAULT_COLLECTION:
        return page(request, "view.html")
    return viewing_page(collection=collection.name)


async def _thumbnail(
    request: Request, container: Container, collection: CollectionNumber, shape: ShapeRecord, size: int
) -> bytes:
    """Return the stored thumbnail of a shape. A missing one is drawn in a worker and stored."""
    key = shape.sha256, shape.format
    stored = await container.database.reading(file_repository.thumbnails, [key], size, DRAWING)
    if key in stored:
        return stored[key]
    async with container.queue.admitted(request):
        drawing = draw_stored(container, collection, shape.id, shape.format, size)
        drawn = await while_connected(request, drawing)
    await store(container, {key: drawn}, size)
    return drawn


async def _preview(container: Container, data: bytes, format: str) -> bytes:
    """Return the mesh of a file as a GLB, made in a worker."""
    mesh = await container.queue.read(data, format)
    return await container.queue.do(tasks.preview, mesh, format, FACES)


def validated(tag: str) -> dict[str, str]:
    """Return headers of a cached answer: the browser of one person keeps it, and validates it each time."""
    return {"ETag": f'"{tag}"', "Cache-Control": "private, no-cache"}
