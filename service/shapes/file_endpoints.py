"""The endpoints of a shape's file and embedding: read, export and replace them."""

import io
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Annotated, Any, Literal
from urllib.parse import quote

import numpy as np
from fastapi import APIRouter, Depends, Header, Query, Request, Response
from fastapi.responses import StreamingResponse

from core.embedding import Embedding
from core.errors import MeshTooComplexError
from core.io import FORMATS, Form, format_of, writable, write_mesh
from core.mesh.mesh import Mesh
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.collections.endpoints import InCollection
from service.container import Container, Service
from service.errors import FileChangedError, NameTakenError
from service.http.middleware import while_connected
from service.http.problems import EXPORT_PROBLEMS, FILE_PROBLEMS, READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once
from service.pipelines.active import fingerprint
from service.shapes import file_repository, repository, service
from service.shapes.endpoints import Replacement, ShapeId
from service.shapes.records import NewFile, ShapeRecord
from service.shapes.schemas import ARRAYS, EmbeddingArrays, Shape
from service.shapes.service import Put, get, store_files
from service.storage.database import ReadSession, WriteSession
from service.turns import current_client

if TYPE_CHECKING:
    WrittenFormat = str
else:
    WrittenFormat = Literal[writable()]

router = APIRouter(tags=["shapes"])

PIECE_BYTES = 256 * 1024

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


async def _pieces(data: bytes) -> AsyncIterator[bytes]:
    """Yield bytes piece by piece: the server would report a whole body as sent at once."""
    for start in range(0, len(data), PIECE_BYTES):
        yield data[start : start + PIECE_BYTES]


async def _receiving(container: Service) -> AsyncIterator[None]:
    """Wait until the client receives few enough files, and count this one until it is sent.

    Raise BusyError if no file has been sent meanwhile.
    """
    shares = container.downloads
    busy = f"this client receives {shares.places} files; try again when one is complete"
    async with shares.taken(current_client.get(), busy):
        yield


@router.head("/shapes/{shape_id}/file", include_in_schema=False)
@router.get(
    "/shapes/{shape_id}/file",
    response_class=Response,
    summary="Get the file",
    dependencies=[once("format"), Depends(_receiving)],
    responses={
        200: {
            "description": "The bytes of the uploaded file, with their SHA-256 as ETag; or the mesh in "
            "another format.",
            "content": {
                media_type: {"schema": {"type": "string", "contentMediaType": media_type}}
                for media_type in sorted(
                    {form.media_type for known in FORMATS.values() for form in known.forms}
                )
            },
        },
        304: {"description": "The client has the file already: its If-None-Match has the ETag."},
        **documented("shape-not-found", "file-in-place", *EXPORT_PROBLEMS, *READ_PROBLEMS),
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
            description="Write the mesh in this format, unless the file has it already: glb is binary, also "
            "of a glTF that is JSON or a ZIP. obj, off and 3mf have the exact coordinates, the others 32 "
            "bits of each. The written file has vertices and triangles only. In 3mf the unit is the "
            "millimetre."
        ),
    ] = None,
) -> Response:
    """Return the bytes of the uploaded file, or its mesh in another format. HEAD gives the headers only."""
    known = request.headers.get("If-None-Match")

    def read(session: ReadSession) -> tuple[ShapeRecord, str, Form, bool, str, bytes | None]:
        shape = service.get(session, collection.number, shape_id)
        kind = shape.format if format is None else str(format)
        form, stored, data = FORMATS[kind].written, kind == shape.format, None
        if stored and FORMATS[kind].variants:
            data = file_repository.file_of(session, collection.number, shape_id)
            if format is None:
                form = FORMATS[kind].form_of(data)
            else:
                stored = FORMATS[kind].form_of(data) == form
        tag = entity_tag(shape.sha256 if stored else f"{shape.sha256}-{kind}")
        if stored and data is None and request.method != "HEAD" and not is_known(known, tag):
            data = file_repository.file_of(session, collection.number, shape_id)
        return shape, kind, form, stored, tag, data

    shape, kind, form, stored, tag, data = await container.database.reading(read)
    if is_known(known, tag):
        return Response(status_code=304, headers={"ETag": tag})
    size = shape.bytes
    if not stored:
        async with container.queue.admitted(request):
            data = await while_connected(request, exported(container, collection.number, shape, kind))
        size = len(data)
    headers = {"Content-Length": str(size), "ETag": tag, "Content-Disposition": disposition(shape.name, form)}
    body = b"" if request.method == "HEAD" or data is None else data
    return StreamingResponse(_pieces(body), media_type=form.media_type, headers=headers)


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
    async with container.queue.admitted(request):
        file = NewFile(await upload.file.read(), mesh_format)
        work = store_replacement(container, collection.number, shape_id, file, if_match)
        record = await while_connected(request, work)
    response.headers["ETag"] = entity_tag(record.sha256)
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
    return Response(as_npz(embedding), media_type="application/zip", headers=headers)


async def exported(
    container: Container, collection: CollectionNumber, shape: ShapeRecord, format: str
) -> bytes:
    """Return the mesh of a shape in another file format; `core.io.write_mesh` lists what is preserved.

    Raise MeshTooComplexError if the file could exceed the limit of an upload, and NonFiniteCoordinatesError
    if a coordinate is too large for the 32 bits of the format.
    """
    data = await container.database.reading(file_repository.file_of, collection, shape.id)
    mesh = await container.queue.read(data, shape.format)
    check_size(mesh, format, container.settings.max_upload_bytes)
    return await container.queue.do(write_mesh, mesh, format)


def check_size(mesh: Mesh, format: str, limit: int) -> None:
    """Raise MeshTooComplexError if the file of a mesh could exceed the limit."""
    written = FORMATS[format]
    size = len(mesh.vertices) * written.vertex_bytes + len(mesh.faces) * written.face_bytes
    if size > limit:
        raise MeshTooComplexError(
            f"the mesh may take {size} bytes as {written.title}; at most {limit} bytes are written"
        )


async def store_replacement(
    container: Container, collection: CollectionNumber, shape_id: str, file: NewFile, if_match: str | None
) -> ShapeRecord:
    """Replace the file of a shape; its id, name, tags and metadata stay.

    Stages: check the shape and If-Match; embed the file in a worker if needed; replace bytes, embedding and
    shape in one transaction. Every query sees either file, and the shape always has an embedding.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    FileChangedError
        If-Match names another file.
    NameTakenError
        Another shape of the collection has the same name and the new file.
    """

    def matching(session: ReadSession) -> ShapeRecord:
        record = get(session, collection, shape_id)
        tag = entity_tag(record.sha256)
        if if_match is not None and not is_known(if_match, tag, weak=False):
            raise FileChangedError(f"the ETag of the file is now {tag}")
        return record

    def replace(session: WriteSession, put: Put) -> ShapeRecord:
        record = matching(session)
        if (record.sha256, record.format) != file.key:
            stored = put(file)
            if repository.same(session, collection, file, record.name) is not None:
                raise NameTakenError(f"another shape has this file and the name {record.name!r}")
            repository.replace_file(session, record, file.format, stored)
        return get(session, collection, shape_id)

    await container.database.reading(matching)
    return (await store_files(container, [file], replace))[0]


def as_npz(embedding: Embedding) -> bytes:
    """Return an embedding as a NumPy archive; names of spectral arrays begin with the spectrum's name."""
    arrays: dict[str, Any] = {name: getattr(embedding, name) for name in ARRAYS}
    for spectrum in embedding.spectra:
        arrays[f"{spectrum.name}_eigenvalues"] = spectrum.eigenvalues
        arrays[f"{spectrum.name}_coordinates"] = spectrum.coordinates
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def disposition(name: str, form: Form) -> str:
    """Return a Content-Disposition that saves the file under the shape's name (RFC 6266).

    Old clients read `filename`, where an underscore replaces unsafe characters; newer ones read `filename*`,
    where unsafe bytes are percent-encoded.
    """
    if name.lower().rpartition(".")[2] not in form.endings:
        name = f"{name}.{form.endings[0]}"
    harmless = "".join(c if c.isascii() and (c.isalnum() or c in " .-_()") else "_" for c in name)
    return f"attachment; filename=\"{harmless}\"; filename*=UTF-8''{quote(name, safe='')}"


def entity_tag(sha256: str) -> str:
    """Return the ETag of bytes with a SHA-256."""
    return f'"{sha256}"'


def is_known(tags: str | None, tag: str, *, weak: bool = True) -> bool:
    """Return whether a header of tags contains one, or is `*`.

    If-None-Match compares weakly, and If-Match does not (RFC 9110, section 8.8.3.2).
    """
    given = [part.strip() for part in (tags or "").split(",")]
    if weak:
        given = [part.removeprefix("W/") for part in given]
    return "*" in given or tag in given
