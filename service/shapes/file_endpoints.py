"""The endpoints of a shape's file and embedding."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Query, Request, Response

from core.io import FORMATS, format_of, writable
from core.serialization import embedding_from_bytes
from service.collections.dependencies import InCollection
from service.dependencies import Service
from service.http.middleware import while_connected
from service.http.problems import EXPORT_PROBLEMS, FILE_PROBLEMS, READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once
from service.pipelines.active import fingerprint
from service.shapes import file_repository, service
from service.shapes import file_service as files
from service.shapes.endpoints import ShapeId
from service.shapes.records import NewFile, ShapeRecord
from service.shapes.schemas import EmbeddingArrays, Shape
from service.shapes.uploads import Replacement
from service.storage.database import ReadSession

if TYPE_CHECKING:
    WrittenFormat = str
else:
    WrittenFormat = Literal[writable()]

router = APIRouter(tags=["shapes"])

REPLACEMENT = RequestBody(Replacement)

IfMatch = Annotated[
    str | None,
    Header(
        alias="If-Match",
        description="The ETag of the file to replace. If the shape has another file by now, nothing changes.",
    ),
]
ETAG_HEADER: dict[str, Any] = {
    "ETag": {"description": "The SHA-256 of the file, in double quotes.", "schema": {"type": "string"}}
}


@router.head("/shapes/{shape_id}/file", include_in_schema=False)
@router.get(
    "/shapes/{shape_id}/file",
    response_class=Response,
    summary="Get the file",
    dependencies=[once("format")],
    responses={
        200: {
            "description": "The bytes of the uploaded file, with their SHA-256 as ETag; or the mesh in "
            "another format.",
            "content": {
                media_type: {"schema": {"type": "string", "contentMediaType": media_type}}
                for media_type in sorted({known.media_type for known in FORMATS.values()})
            },
        },
        304: {"description": "The client has the file already: its If-None-Match has the ETag."},
        **documented("shape-not-found", *EXPORT_PROBLEMS, *READ_PROBLEMS),
    },
)
async def read_file(
    shape_id: ShapeId,
    request: Request,
    container: Service,
    collection: InCollection,
    format: Annotated[
        WrittenFormat | None,
        Query(
            description="Write the mesh in this format, unless the file has it already. obj, off and 3mf "
            "have the exact coordinates, the others 32 bits of each. The written file has vertices and "
            "triangles only. In 3mf the unit is the millimetre."
        ),
    ] = None,
) -> Response:
    """Return the bytes of the uploaded file, or its mesh in another format. HEAD gives the headers only."""
    known = request.headers.get("If-None-Match")

    def read(session: ReadSession) -> tuple[ShapeRecord, str, str, bytes | None]:
        shape = service.get(session, collection.number, shape_id)
        kind = shape.format if format is None else str(format)
        tag = files.entity_tag(shape.sha256 if kind == shape.format else f"{shape.sha256}-{kind}")
        wanted = request.method != "HEAD" and kind == shape.format and not files.is_known(known, tag)
        data = file_repository.file_of(session, collection.number, shape_id) if wanted else None
        return shape, kind, tag, data

    shape, kind, tag, data = await container.database.reading(read)
    if files.is_known(known, tag):
        return Response(status_code=304, headers={"ETag": tag})
    size = shape.bytes
    if kind != shape.format:
        with container.queue.admitted():
            data = await while_connected(request, files.exported(container, collection.number, shape, kind))
        size = len(data)
    headers = {
        "Content-Length": str(size),
        "ETag": tag,
        "Content-Disposition": files.disposition(shape.name, kind),
        "X-Content-Type-Options": "nosniff",
    }
    body = b"" if request.method == "HEAD" else data
    return Response(body, media_type=FORMATS[kind].media_type, headers=headers)


@router.put(
    "/shapes/{shape_id}/file",
    summary="Replace the file",
    response_model=Shape,
    response_description="The shape has the new file, and the next query uses it.",
    responses={
        200: {"headers": ETAG_HEADER},
        **documented(*FILE_PROBLEMS, "shape-not-found", "name-taken", "file-changed", *WRITE_PROBLEMS),
    },
    openapi_extra=REPLACEMENT.openapi,
)
async def replace_file(
    shape_id: ShapeId,
    request: Request,
    response: Response,
    container: Service,
    collection: InCollection,
    upload: Annotated[Replacement, Depends(REPLACEMENT, scope="function")],
    if_match: IfMatch = None,
) -> Shape:
    """Read another file and embed its mesh; the shape's id, name, tags and metadata stay."""
    mesh_format = format_of(upload.file.filename or "")
    with container.queue.admitted():
        file = NewFile(await upload.file.read(), mesh_format)
        work = files.replace_file(container, collection.number, shape_id, file, if_match)
        record = await while_connected(request, work)
    response.headers["ETag"] = files.entity_tag(record.sha256)
    return Shape.of(record)


@router.get(
    "/shapes/{shape_id}/embedding",
    summary="Get the embedding",
    response_model=EmbeddingArrays,
    dependencies=[once("format")],
    responses={
        200: {
            "description": "The arrays, as JSON or as a NumPy archive.",
            "content": {
                "application/zip": {"schema": {"type": "string", "contentMediaType": "application/zip"}}
            },
        },
        **documented("shape-not-found", "not-embedded", *READ_PROBLEMS),
    },
)
def read_embedding(
    shape_id: ShapeId,
    container: Service,
    collection: InCollection,
    format: Annotated[
        Literal["json", "npz"],
        Query(
            description="npz is for `numpy.load`; the names of a spectrum's arrays begin with the name of "
            "the spectrum."
        ),
    ] = "json",
) -> EmbeddingArrays | Response:
    """Return the embedding by the active pipeline: samples, graph, tree, signature and spectra."""
    with container.database.read() as session:
        stored = file_repository.embedding_of(session, fingerprint(session), collection.number, shape_id)
    embedding = embedding_from_bytes(stored.record)
    if format == "json":
        return EmbeddingArrays.of(embedding)
    headers = {"Content-Disposition": f'attachment; filename="{embedding.fingerprint}.npz"'}
    return Response(files.as_npz(embedding), media_type="application/zip", headers=headers)
