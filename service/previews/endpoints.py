"""The addresses of pictures."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response

from core.io import format_of
from service.collection import DEFAULT_COLLECTION
from service.collections.dependencies import InCollection
from service.dependencies import Service
from service.http.disconnects import while_connected
from service.http.duplicate_parameters import once
from service.http.problems import documented
from service.http.request_bodies import RequestBody
from service.previews import service
from service.rendering.glb import MEDIA_TYPE
from service.rendering.tasks import FACES
from service.rendering.thumbnail import DRAWING
from service.shapes import files
from service.shapes.documentation import FILE_PROBLEMS, READ_PROBLEMS
from service.shapes.endpoints import ShapeId
from service.shapes.uploads import MeshUpload
from service.web.answers import page, viewing_page

router = APIRouter(tags=["shapes"])

MESH = RequestBody(MeshUpload)

WORK_PROBLEMS = (
    *READ_PROBLEMS,
    "shape-not-found",
    "busy",
    "shutting-down",
    "worker-lost",
    "cluster-unavailable",
    "file-time-limit",
)
GLB = {MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}}}
KNOWN: dict[int | str, dict[str, Any]] = {
    304: {"description": "The client has it already, by its If-None-Match."}
}


@router.get(
    "/shapes/{shape_id}/thumbnail.png",
    summary="Get a picture",
    response_class=Response,
    dependencies=[once("size")],
    responses={
        200: {
            "description": "A picture on a transparent ground.",
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
    size: Annotated[Literal["64", "128", "256", "512"], Query(description="Pixels a side.")] = "256",
) -> Response:
    """The shape drawn once for each size, and kept. z is up, but in OBJ and GLB y."""
    shape = await service.record(container, collection.number, shape_id)
    headers = _headers(f"{shape.sha256[:32]}-{shape.format}-{size}-{DRAWING}")
    if files.is_known(request.headers.get("If-None-Match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    data = await while_connected(request, service.thumbnail(container, collection.number, shape, int(size)))
    return Response(data, media_type="image/png", headers=headers)


@router.get(
    "/shapes/{shape_id}/preview.glb",
    summary="Get the mesh to show",
    response_class=Response,
    responses={
        200: {"description": f"A GLB of about {FACES} faces at most.", "content": GLB},
        **KNOWN,
        **documented(*WORK_PROBLEMS),
    },
)
async def read_preview(
    shape_id: ShapeId, request: Request, container: Service, collection: InCollection
) -> Response:
    """The mesh as a viewer shows it: whatever the file's format, simplified if it is large, and y up.

    Positions are stored between -1 and 1. The node's `extras` tell the way back: a point p of the file is
    stored as (p - middle) / half.
    """
    shape = await service.record(container, collection.number, shape_id)
    headers = _headers(f"{shape.sha256[:32]}-{shape.format}-{FACES}-preview-1")
    if files.is_known(request.headers.get("If-None-Match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    with container.work.admitted():
        data = await service.stored_file(container, collection.number, shape_id)
        made = await while_connected(request, service.preview(container, data, shape.format))
    return Response(made, media_type=MEDIA_TYPE, headers=headers)


@router.post(
    "/preview",
    summary="Get a mesh to show, without storing it",
    response_class=Response,
    responses={
        200: {"description": f"A GLB of about {FACES} faces at most.", "content": GLB},
        **documented(*FILE_PROBLEMS, "storage-full"),
    },
    openapi_extra=MESH.openapi,
)
async def make_preview(
    request: Request, container: Service, upload: Annotated[MeshUpload, Depends(MESH, scope="function")]
) -> Response:
    """The preview of a file that is not stored: a page shows it beside the answer to a query."""
    mesh_format = format_of(upload.file.filename or "")
    with container.work.admitted():
        data = await upload.file.read()
        glb = await while_connected(request, service.preview(container, data, mesh_format))
    return Response(glb, media_type=MEDIA_TYPE)


@router.get(
    "/shapes/{shape_id}/view",
    summary="Look at a shape",
    response_class=Response,
    responses={
        200: {"description": "A page.", "content": {"text/html": {"schema": {"type": "string"}}}},
        **documented("shape-not-found", *READ_PROBLEMS),
    },
)
async def view_shape(
    shape_id: ShapeId, request: Request, container: Service, collection: InCollection
) -> Response:
    """A page with the one shape in 3D."""
    await service.record(container, collection.number, shape_id)
    if collection == DEFAULT_COLLECTION:
        return page(request, "view.html")
    return viewing_page(collection.name)


def _headers(tag: str) -> dict[str, str]:
    """Kept by the browser of one person, and asked for again each time."""
    return {"ETag": f'"{tag}"', "Cache-Control": "private, no-cache", "X-Content-Type-Options": "nosniff"}
