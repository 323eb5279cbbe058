"""The addresses under /shapes."""

from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import Field, ValidationError
from starlette.concurrency import run_in_threadpool

from core.io import READABLE, format_of
from service.collections.dependencies import InCollection, NamedInAddress, address
from service.dependencies import Service
from service.errors import BadRequestFieldsError, FieldFault
from service.http.access_control import KEY_IN_SCOPE
from service.http.disconnects import while_connected
from service.http.idempotency.keys import HEADER, REPLAYED, payload_of, read_key
from service.http.idempotency.records import Claim
from service.http.problem_document import faults_of
from service.http.problems import documented
from service.http.uploads import Form, single, uploaded
from service.pipelines.active import fingerprint
from service.shapes import exporting, files, replacing, service
from service.shapes.documentation import (
    ETAG_HEADER,
    EXPORT_PROBLEMS,
    FILE_BODY,
    FILE_PROBLEMS,
    IDEMPOTENCY_KEY,
    IDEMPOTENCY_PROBLEMS,
    IF_MATCH,
    READ_PROBLEMS,
    REPLAYED_HEADER,
    UPLOAD_BODY,
    WRITE_PROBLEMS,
)
from service.shapes.fields import base_name, read_metadata, split_tags
from service.shapes.filters import Filters
from service.shapes.pages import read_cursor
from service.shapes.records import NewFile, NewShape, ShapeRecord, StoredShape
from service.shapes.schemas import EmbeddingArrays, Shape, ShapeChanges, ShapeFields, ShapePage

router = APIRouter(tags=["shapes"])

ShapeId = Annotated[str, Path(description="The id of a stored shape.", max_length=64)]


class Listing(NamedInAddress, Filters):
    """Which shapes to list."""

    cursor: str | None = Field(
        default=None, max_length=256, description="The `next_cursor` of the page before."
    )
    limit: int = Field(default=50, ge=1, le=500, description="How many shapes at most.")


@router.post(
    "/shapes",
    status_code=201,
    summary="Store a mesh",
    response_model=Shape,
    response_description="Stored. It is durable, and the next query sees it.",
    responses={
        200: {
            "model": Shape,
            "description": "The same bytes are stored under this name already; this is that shape.",
            "headers": REPLAYED_HEADER,
        },
        201: {"headers": REPLAYED_HEADER},
        **documented(*FILE_PROBLEMS, *IDEMPOTENCY_PROBLEMS, *WRITE_PROBLEMS),
    },
    openapi_extra={"parameters": [IDEMPOTENCY_KEY], "requestBody": UPLOAD_BODY},
)
async def create_shape(request: Request, container: Service, collection: InCollection) -> Response:
    """Read the file, embed its mesh, and store both with a name, tags and metadata.

    The same bytes may be stored under several names: they, and their embedding, are kept once. The same bytes
    under the same name are one shape of the collection, so that an upload may be repeated safely; tags and
    metadata of such a repetition are not looked at.
    """
    settings = container.settings
    key = read_key(request.headers.getlist(HEADER))
    async with uploaded(
        request, max_bytes=settings.max_upload_bytes, max_fields=settings.max_form_fields
    ) as form:
        fields = _fields(form.fields, form.filename)
        mesh_format = format_of(form.filename)
        with container.work.admitted():
            new = NewShape(
                data=await form.bytes(),
                format=mesh_format,
                collection=collection.number,
                name=fields.name,
                tags=tuple(fields.tags),
                metadata=fields.metadata,
            )
            claim = None if key is None else _claim(request, container, key, new, form)
            with container.in_flight.taken(claim):
                done = await while_connected(request, service.ingest(container, new, claim))
    answer = service.answer_of(done) if isinstance(done, StoredShape) else done
    headers = {"Location": address(answer.location, collection)}
    if answer is done:
        headers[REPLAYED] = "true"
    return Response(answer.body, answer.status, headers=headers, media_type="application/json")


@router.get("/shapes", summary="List shapes", responses=documented(*READ_PROBLEMS))
def list_shapes(
    listing: Annotated[Listing, Query()], container: Service, collection: InCollection
) -> ShapePage:
    """The stored shapes, oldest first, a page at a time.

    A shape that is stored while you page comes on the last page; none is shown twice or left out.
    """
    after = read_cursor(listing.cursor)
    wanted = listing.filtered(collection.number)
    with container.database.read() as session:
        page = service.list_page(session, fingerprint(session), wanted, after=after, limit=listing.limit)
    return ShapePage.of(page)


@router.get(
    "/shapes/{shape_id}", summary="Read a shape", responses=documented("shape-not-found", *READ_PROBLEMS)
)
def read_shape(shape_id: ShapeId, container: Service, collection: InCollection) -> Shape:
    """The record of a shape: what it is called, and what was measured on its mesh."""
    with container.database.read() as session:
        return Shape.of(service.get(session, fingerprint(session), collection.number, shape_id))


@router.patch(
    "/shapes/{shape_id}",
    summary="Change a shape",
    responses=documented("bad-request", "shape-not-found", "name-taken", "body-too-large", *WRITE_PROBLEMS),
)
def change_shape(
    shape_id: ShapeId, changes: ShapeChanges, container: Service, collection: InCollection
) -> Shape:
    """Change name, tags or metadata. Each that is given replaces the old one whole."""
    with container.database.write() as session:
        own = fingerprint(session), collection.number, shape_id
        return Shape.of(service.change(session, *own, changes.changes()))


@router.head("/shapes/{shape_id}/file", include_in_schema=False)
@router.get(
    "/shapes/{shape_id}/file",
    response_class=Response,
    summary="Get the file",
    responses={
        200: {
            "description": "The bytes that were uploaded, with their SHA-256 as ETag; or the mesh in another "
            "format.",
            "content": {
                media_type: {"schema": {"type": "string", "contentMediaType": media_type}}
                for media_type in sorted({files.media_type(name) for name in READABLE})
            },
        },
        304: {"description": "The client has the file already, by its If-None-Match."},
        **documented("shape-not-found", *EXPORT_PROBLEMS, *READ_PROBLEMS),
    },
)
async def read_file(
    shape_id: ShapeId,
    request: Request,
    container: Service,
    collection: InCollection,
    format: Annotated[
        Literal["stl", "obj", "ply", "off", "glb", "3mf"] | None,
        Query(
            description="Have the mesh written in this format, unless the file is of it. obj, off and 3mf "
            "hold the very coordinates, the others 32 bits of each; nothing but vertices and triangles is "
            "written. 3mf takes the coordinates for millimetres."
        ),
    ] = None,
) -> Response:
    """The very bytes that were uploaded, or their mesh in another format. HEAD gives the headers alone."""
    known = request.headers.get("If-None-Match")

    def read() -> tuple[ShapeRecord, str, str, bytes | None]:
        with container.database.read() as session:
            shape = service.get(session, fingerprint(session), collection.number, shape_id)
            kind = shape.format if format is None else str(format)
            tag = files.entity_tag(shape.sha256 if kind == shape.format else f"{shape.sha256}-{kind}")
            wanted = request.method != "HEAD" and kind == shape.format and not files.is_known(known, tag)
            if not wanted:
                return shape, kind, tag, None
            return shape, kind, tag, service.get_file(session, collection.number, shape_id)

    shape, kind, tag, data = await run_in_threadpool(read)
    if files.is_known(known, tag):
        return Response(status_code=304, headers={"ETag": tag})
    size = shape.size
    if kind != shape.format:
        with container.work.admitted():
            data = await while_connected(
                request, exporting.exported(container, collection.number, shape, kind)
            )
        size = len(data)
    headers = {
        "Content-Length": str(size),
        "ETag": tag,
        "Content-Disposition": files.disposition(shape.name, kind),
        "X-Content-Type-Options": "nosniff",
    }
    body = b"" if request.method == "HEAD" else data
    return Response(body, media_type=files.media_type(kind), headers=headers)


@router.put(
    "/shapes/{shape_id}/file",
    summary="Replace the file",
    response_model=Shape,
    response_description="The shape is of the new file, and the next query sees it so.",
    responses={
        200: {"headers": ETAG_HEADER},
        **documented(*FILE_PROBLEMS, "shape-not-found", "name-taken", "file-changed", *WRITE_PROBLEMS),
    },
    openapi_extra={"parameters": [IF_MATCH], "requestBody": FILE_BODY},
)
async def replace_file(
    shape_id: ShapeId, request: Request, response: Response, container: Service, collection: InCollection
) -> Shape:
    """Read another file and embed its mesh; the shape's id, name, tags and metadata stay."""
    settings = container.settings
    async with uploaded(request, max_bytes=settings.max_upload_bytes, max_fields=1) as form:
        if form.fields:
            raise BadRequestFieldsError(*(FieldFault(name, "not taken here") for name in form.fields))
        mesh_format = format_of(form.filename)
        with container.work.admitted():
            file = NewFile(await form.bytes(), mesh_format)
            if_match = request.headers.get("If-Match")
            work = replacing.replace_file(container, collection.number, shape_id, file, if_match)
            record = await while_connected(request, work)
    response.headers["ETag"] = files.entity_tag(record.sha256)
    return Shape.of(record)


@router.get(
    "/shapes/{shape_id}/embedding",
    summary="Get the embedding",
    response_model=EmbeddingArrays,
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
        Query(description="npz is for `numpy.load`; a spectrum's arrays begin with its name."),
    ] = "json",
) -> EmbeddingArrays | Response:
    """What the pipeline in use made of the shape: samples, graph, tree, signature and spectra."""
    with container.database.read() as session:
        embedding = service.get_embedding(session, fingerprint(session), collection.number, shape_id)
    if format == "json":
        return EmbeddingArrays.of(embedding)
    headers = {"Content-Disposition": f'attachment; filename="{embedding.fingerprint}.npz"'}
    return Response(service.as_npz(embedding), media_type="application/zip", headers=headers)


def _claim(request: Request, container: Service, key: str, new: NewShape, form: Form) -> Claim:
    return Claim(
        collection=new.collection,
        scope=request.scope.get(KEY_IN_SCOPE, ""),
        key=key,
        payload=payload_of(new.sha256, form.filename, form.fields),
        expires_at=datetime.now(UTC) + timedelta(hours=container.settings.idempotency_hours),
    )


def _fields(form: dict[str, list[str]], filename: str) -> ShapeFields:
    """The text fields of an upload, or a refusal that names what is wrong."""
    values: dict[str, Any] = {name: single(form, name) for name in form if name != "tags"}
    values["name"] = values.get("name") or base_name(filename)
    values["tags"] = split_tags(form.get("tags", []))
    values["metadata"] = read_metadata(values.get("metadata") or "{}")
    try:
        return ShapeFields.model_validate(values)
    except ValidationError as error:
        raise BadRequestFieldsError(*faults_of(error.errors())) from error
