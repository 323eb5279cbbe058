"""The addresses under /shapes and /deleted, and the forms of uploads."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Path, Query, Request, Response, UploadFile
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Json, WithJsonSchema

from core.io import FORMATS, format_of
from service.collections.endpoints import InCollection, NamedInAddress, address, limits_of, named_too
from service.container import Container, Service
from service.http.idempotency import HEADER, KEPT_TIME, REPLAYED, Claim, Kept, payload_of, read_key
from service.http.middleware import KEY_IN_SCOPE, while_connected
from service.http.problems import (
    FILE_PROBLEMS,
    IDEMPOTENCY_PROBLEMS,
    READ_PROBLEMS,
    WRITE_PROBLEMS,
    documented,
)
from service.http.request_bodies import FILE, RequestBody, once, once_each
from service.shapes import bulk_changes, facet_repository, rule_repository, service
from service.shapes.bulk_schemas import BulkChange, BulkChanged, MetadataRules, NewMetadataRules, RulesApplied
from service.shapes.facets import Facets
from service.shapes.fields import (
    METADATA_BYTES,
    METADATA_DEPTH,
    METADATA_KEYS,
    TAG_CHARACTERS,
    TAGS,
    Id,
    ListedTags,
    Metadata,
    base_name,
    clean_name,
)
from service.shapes.records import NewShape, ShapeFilter, Sort
from service.shapes.schemas import (
    Assembly,
    DeletedShapePage,
    Filters,
    Shape,
    ShapeChanges,
    ShapePage,
    UploadedShape,
    read_cursor,
    read_position,
)

_ALWAYS, _EXTRA = (
    [ending for known in FORMATS.values() if bool(known.package) == extra for ending in known.endings]
    for extra in (False, True)
)
ENDINGS_IN_WORDS = (
    f"The ending of the file's name is its format: {', '.join(sorted(_ALWAYS))}, and {' and '.join(_EXTRA)} "
    "where the service has the extra for them."
)
"""The formats of uploads, for the documentation."""

MeshFile = Annotated[
    UploadFile, Field(description=f"The mesh. {ENDINGS_IN_WORDS} 3MF and STEP are read in millimetres.")
]


FormName = Annotated[
    str,
    BeforeValidator(lambda name, info: name or base_name(info.data["file"].filename or "")),
    AfterValidator(clean_name),
    Field(
        default_factory=str,
        validate_default=True,
        description="The name of the shape: 1 to 255 characters. Unless given, the file's own name, without "
        "its folders.",
    ),
]
FormTags = Annotated[
    ListedTags,
    Field(
        description=f"Up to {TAGS} tags: the field repeated, one field with commas, or both.",
        default_factory=list,
        json_schema_extra={"maxItems": TAGS},
    ),
]
FormMetadata = Annotated[
    Json[Metadata],
    BeforeValidator(lambda text: text or "{}"),
    WithJsonSchema({"type": "string", "contentMediaType": "application/json"}),
    Field(
        default_factory=dict,
        description=f"A JSON object, as text: up to {METADATA_KEYS} keys, {METADATA_DEPTH} levels and "
        f"{METADATA_BYTES} bytes.",
        examples=['{"source": "scan", "year": 2024}'],
    ),
]


class MeshUpload(BaseModel):
    """A mesh."""

    file: MeshFile


class Replacement(MeshUpload):
    """A mesh, and nothing else."""

    model_config = ConfigDict(extra="forbid")


class ShapeUpload(Replacement):
    """A mesh to store, and the text that people write about it."""

    name: FormName
    tags: FormTags
    metadata: FormMetadata
    split: Literal["parts"] | None = Field(
        default=None,
        description="`parts`: a STEP or 3MF is one shape, and each of its distinct parts is another, with "
        "the metadata `assembly` (the name of the whole shape), `assembly_path` (the names from the root to "
        "the first instance of the part) and `instances`. The service stores all of them or none. A file of "
        "one part or of another format is one shape.",
    )


RESTORE_PROBLEMS = (
    *FILE_PROBLEMS,
    *("shape-not-found", "file-in-place", "name-taken", "pipeline-unavailable"),
    *WRITE_PROBLEMS,
)

router = APIRouter(tags=["shapes"])

SHAPE = RequestBody(ShapeUpload)

ShapeId = Annotated[Id, Path(description="The id of a stored shape.")]

NamedKey = Annotated[
    str | None,
    Header(
        alias=HEADER,
        description="A name for the upload, so that a client may send it again: a string in double quotes, "
        "such as a UUID (draft-ietf-httpapi-idempotency-key-header). The same key with the same file and "
        "fields gets the first answer again, for as long as the service keeps that answer; the same key "
        "with another file or other fields is refused. The service keeps no answer of an upload that stored "
        "nothing, and tries such an upload again.",
        json_schema_extra={
            "pattern": r'^"([ !#-\[\]-~]|\\["\\]){1,255}"$',
            "examples": ['"8e03978e-40d5-43e8-bc93-6894a57f9324"'],
        },
    ),
]


async def _idempotency_key(request: Request, _named: NamedKey = None) -> str | None:
    # A header that is repeated is refused, which FastAPI's parameter does not show.
    return read_key(request.headers.getlist(HEADER))


IdempotencyKey = Annotated[str | None, Depends(_idempotency_key)]

REPLAYED_HEADER: dict[str, Any] = {
    REPLAYED: {
        "description": "`true` if this is the answer to an earlier request with the same Idempotency-Key.",
        "schema": {"type": "string", "const": "true"},
    }
}


class PageOptions(NamedInAddress):
    """A page of a list."""

    cursor: str | None = Field(
        default=None, max_length=256, description="The `next_cursor` of the previous page."
    )
    limit: int = Field(default=50, ge=1, le=500, description="The largest number of items of the page.")


class ShapeListing(PageOptions, Filters):
    """A page of shapes, and their filter."""

    sort: Sort = Field(
        default="relevance",
        description="The order: the best match of `q` first, the oldest or the newest first, or by name, "
        "upper and lower case alike. Without `q`, relevance is the oldest first. A cursor belongs to one "
        "order.",
    )

    sha256: str | None = Field(
        default=None,
        pattern="^[0-9a-f]{64}$",
        description="Only shapes whose file has this SHA-256: a client that hashes a file learns, before it "
        "uploads the file, as which shapes it is stored. `likeness` in the answer of a query finds copies "
        "that have other bytes.",
    )

    @property
    def order(self) -> Sort:
        """The order of the list: without words, no shape is more relevant than another."""
        return "oldest" if self.sort == "relevance" and not self.q else self.sort


class FacetOptions(NamedInAddress, Filters):
    """The shapes to count, and the tags."""

    tag_text: str = Field(
        default="",
        max_length=TAG_CHARACTERS,
        description="Count only tags that contain this text; upper and lower case are equal.",
    )
    limit: int = Field(default=100, ge=1, le=1000, description="The largest number of tags.")


class DeletedListing(PageOptions):
    """A page of deleted shapes."""

    model_config = ConfigDict(extra="forbid")


@router.post(
    "/shapes",
    status_code=201,
    summary="Store a mesh",
    response_model=UploadedShape | Assembly,
    response_description="Stored durably. The next query finds the shape. With split=parts, the answer "
    "has its parts too.",
    responses={
        200: {
            "model": UploadedShape | Assembly,
            "description": "The same bytes are already stored under this name; the answer is that shape, and "
            "`changed` tells what the upload added. With split=parts, all shapes of the assembly are already "
            "stored.",
            "headers": REPLAYED_HEADER,
        },
        201: {"headers": REPLAYED_HEADER},
        **documented(*FILE_PROBLEMS, *IDEMPOTENCY_PROBLEMS, *WRITE_PROBLEMS),
    },
    openapi_extra=SHAPE.openapi,
)
async def create_shape(
    request: Request,
    container: Service,
    collection: InCollection,
    key: IdempotencyKey,
    upload: Annotated[ShapeUpload, Depends(SHAPE, scope="function")],
) -> Response:
    """Read the file, embed its mesh, and store both with a name, tags and metadata.

    The same bytes may be stored under several names; the service keeps one copy of the bytes and of their
    embedding. The same bytes under the same name are one shape of the collection, so clients may repeat an
    upload safely. The tags of the repetition join those of the shape, and its metadata override equal keys.

    With split=parts, the distinct parts of a STEP or 3MF are shapes of their own. Each is a 3MF named
    "assembly/part", with the tags and the metadata of the whole besides its own. The Location is that of the
    whole. Shapes of an assembly are independent afterwards: each is changed, deleted and restored by itself.
    """
    mesh_format = format_of(upload.file.filename or "")
    async with container.queue.admitted(request):
        new = NewShape(
            data=await upload.file.read(),
            format=mesh_format,
            collection=collection.number,
            name=upload.name,
            tags=tuple(upload.tags),
            metadata=upload.metadata,
        )
        claim = None if key is None else await _claim(request, container, key, new, upload.file.filename)
        with container.in_flight.taken(claim):
            split = upload.split is not None
            done = await while_connected(request, service.ingest(container, new, claim, split=split))
    answer = done if isinstance(done, Kept) else service.answer_of(done, split=split)
    headers = {"Location": address(answer.location, collection)}
    if isinstance(done, Kept):
        headers[REPLAYED] = "true"
    return Response(answer.body, answer.status, headers=headers, media_type="application/json")


@router.get(
    "/shapes",
    summary="List shapes",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(ShapeListing)],
)
def list_shapes(
    listing: Annotated[ShapeListing, Query()], container: Service, collection: InCollection
) -> ShapePage:
    """Return the stored shapes, a page at a time.

    No shape is repeated or left out. With the oldest first, a shape that is stored between two pages comes on
    the last page.
    """
    sort = listing.order
    after = read_position(listing.cursor, sort)
    wanted = replace(listing.filtered(collection), sha256=listing.sha256)
    with container.database.read() as session:
        return service.list_page(session, wanted, after=after, limit=listing.limit, sort=sort)


@router.get(
    "/facets",
    summary="Count shapes",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(FacetOptions)],
)
def read_facets(
    options: Annotated[FacetOptions, Query()], request: Request, container: Service, collection: InCollection
) -> Facets:
    """Return how many of the shapes that pass the filter have each tag, format and length.

    With `tag_text`, the tags complete what somebody writes.
    """
    names, wanted = limits_of(request), options.filtered(collection)
    with container.database.read() as session:
        return facet_repository.facets(session, wanted, names, options.tag_text, options.limit)


@router.get(
    "/shapes/{shape_id}", summary="Read a shape", responses=documented("shape-not-found", *READ_PROBLEMS)
)
def read_shape(shape_id: ShapeId, container: Service, collection: InCollection) -> Shape:
    """Return the record of a shape: its name, tags and metadata, and the measures of its mesh."""
    with container.database.read() as session:
        return Shape.of(service.get(session, collection.number, shape_id))


@router.patch(
    "/shapes/{shape_id}",
    summary="Change a shape",
    responses=documented("shape-not-found", "name-taken", *WRITE_PROBLEMS),
)
def change_shape(
    shape_id: ShapeId, changes: ShapeChanges, request: Request, container: Service, collection: InCollection
) -> Shape:
    """Change name, tags or metadata, or move the shape to another collection.

    A given field replaces the old value whole.
    """
    with container.database.write() as session:
        name = collection.name if changes.collection is None else changes.collection
        target = named_too(session, request, name)
        return Shape.of(service.change(session, collection.number, shape_id, changes, target.number))


@router.patch(
    "/shapes",
    summary="Change all shapes that pass a filter",
    responses=documented("collection-not-found", "busy", "shutting-down", *WRITE_PROBLEMS),
)
async def change_shapes(
    wanted: BulkChange, request: Request, container: Service, collection: InCollection
) -> BulkChanged:
    """Add or remove tags and entries of the metadata, or move the shapes. A dry run counts them.

    The shapes change one after another; if the request is cut off, the rest stays, and it can be sent again.
    """
    database, number = container.database, collection.number
    name = collection.name if wanted.collection is None else wanted.collection
    shapes = wanted.filtered(collection)

    async def apply() -> BulkChanged:
        target = (await database.reading(named_too, request, name)).number
        numbers = await database.reading(bulk_changes.matching, shapes)
        if wanted.dry_run:
            moves = target != number
            return await database.reading(bulk_changes.would_change, number, numbers, wanted, moves)
        report = BulkChanged(matched=len(numbers), changed=0, refused=[])
        for start in range(0, len(numbers), bulk_changes.AT_ONCE):
            some = numbers[start : start + bulk_changes.AT_ONCE]
            await database.writing(bulk_changes.change, number, some, wanted, target, report)
        return report

    async with container.queue.admitted(request):
        return await while_connected(request, apply())


@router.get("/rules", summary="Read the rules of a collection", responses=documented(*READ_PROBLEMS))
def read_rules(container: Service, collection: InCollection) -> MetadataRules:
    """Return the tags that shapes of the collection get by their metadata."""
    with container.database.read() as session:
        return MetadataRules(rules=rule_repository.rules_of(session, collection.number))


@router.put(
    "/rules",
    summary="Set the rules of a collection",
    responses=documented("busy", "shutting-down", *WRITE_PROBLEMS),
)
async def set_rules(
    new: NewMetadataRules, request: Request, container: Service, collection: InCollection
) -> RulesApplied:
    """Have shapes tagged by their metadata: those that are stored, and every shape or entry that comes later.

    Tags that shapes have stay. A shape that would have too many gets none. If the request is cut off, it can
    be sent again.
    """
    database, number = container.database, collection.number

    async def apply() -> RulesApplied:
        await database.writing(rule_repository.set_rules, number, new.rules)
        numbers = await database.reading(bulk_changes.matching, ShapeFilter(number))
        changed = 0
        for start in range(0, len(numbers), bulk_changes.AT_ONCE):
            some = numbers[start : start + bulk_changes.AT_ONCE]
            changed += await database.writing(bulk_changes.tag_by_rules, number, some)
        return RulesApplied(rules=new.rules, changed=changed)

    async with container.queue.admitted(request):
        return await while_connected(request, apply())


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
    """Delete a shape, which can be restored for as long as the service is set to keep deleted shapes.

    With `permanent`, the shape is erased, and its file and embedding unless another shape has the same bytes.
    """
    keep = timedelta(0) if permanent else container.settings.undo_time
    with container.database.write(deleting=True) as session:
        service.delete(session, collection.number, shape_id, keep)


@router.post(
    "/shapes/{shape_id}/restore", summary="Restore a deleted shape", responses=documented(*RESTORE_PROBLEMS)
)
async def restore_shape(
    shape_id: ShapeId, request: Request, container: Service, collection: InCollection
) -> Shape:
    """Undo a deletion: the shape has its id, name, tags and metadata again, and its place in the lists.

    Its file is embedded if the pipeline in use has not embedded it.
    """
    async with container.queue.admitted(request):
        restored = service.restore(container, collection.number, shape_id)
        return Shape.of(await while_connected(request, restored))


@router.get(
    "/deleted",
    summary="List deleted shapes",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(DeletedListing)],
)
def list_deleted(
    listing: Annotated[DeletedListing, Query()], container: Service, collection: InCollection
) -> DeletedShapePage:
    """Return the shapes that can be restored, in the order of their deletion, a page at a time."""
    after, keep = read_cursor(listing.cursor), container.settings.undo_time
    with container.database.read() as session:
        return service.list_deleted(session, collection.number, keep, after=after, limit=listing.limit)


@router.delete(
    "/deleted/{shape_id}",
    status_code=204,
    summary="Purge a deleted shape",
    responses=documented("shape-not-found", *WRITE_PROBLEMS),
)
def purge_shape(shape_id: ShapeId, container: Service, collection: InCollection) -> None:
    """Erase a deleted shape and its file now, for good."""
    with container.database.write(deleting=True) as session:
        service.purge(session, collection.number, shape_id, container.settings.undo_time)


async def _claim(
    request: Request, container: Container, key: str, new: NewShape, filename: str | None
) -> Claim:
    # The form as it was sent, which the dependency has read.
    form = await request.form()
    fields = {name: [str(value) for value in form.getlist(name)] for name in form if name != FILE}
    return Claim(
        collection=new.collection,
        scope=request.scope.get(KEY_IN_SCOPE, ""),
        key=key,
        payload=payload_of(new.sha256, filename or "", fields),
        expires_at=datetime.now(UTC) + KEPT_TIME,
    )
