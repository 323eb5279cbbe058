"""Operations on shapes: store, list, read, change and delete.

Functions that take the id of a shape raise ShapeNotFoundError if the collection has no such shape, or no such
deleted shape.
"""

import asyncio
import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, TypeVar

from starlette.concurrency import run_in_threadpool

from core.errors import MeshError
from core.pipeline import Pipeline
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.compute.request_queue import together
from service.compute.sandbox import PartFile
from service.compute.tasks import Embedded
from service.container import Container
from service.errors import (
    BadRequestFieldsError,
    FieldFault,
    FileTimeLimitError,
    NameTakenError,
    ServiceError,
    ShapeNotFoundError,
)
from service.http.idempotency import Claim, Kept
from service.observability.logging import get_logger
from service.observability.metrics import Timings
from service.pipelines.active import fingerprint as active_fingerprint
from service.shapes import file_repository, repository
from service.shapes.fields import NAME_CHARACTERS, clean_metadata, clean_name, clean_tags
from service.shapes.records import (
    FileKey,
    NewFile,
    NewShape,
    Position,
    ShapeFilter,
    ShapeRecord,
    Sort,
    StoredFile,
    StoredShape,
)
from service.shapes.schemas import (
    Assembly,
    DeletedShape,
    DeletedShapePage,
    Shape,
    ShapeChanges,
    ShapePage,
    UploadedShape,
    write_cursor,
)
from service.storage.database import Database, ReadSession, WriteSession
from service.storage.in_place import is_in_source

log = get_logger("shapes")

PURGE_SECONDS = 600.0

ASSEMBLY, PATH, INSTANCES = "assembly", "assembly_path", "instances"
"""Keys of a part's metadata: the name of the whole shape, the names from the root of the assembly to the
first instance of the part, and the number of instances."""

# The format that parts are written in, which states its unit.
_PART_FORMAT = "3mf"
_PATH_CHARACTERS = 1_000

T = TypeVar("T")
Put = Callable[[NewFile], StoredFile]
"""A function that stores a file within a transaction."""


class EmbeddingMissingError(Exception):
    """A file must be embedded first: another pipeline became active, or its last shape was deleted."""


async def ingest(
    container: Container,
    new: NewShape,
    claim: Claim | None = None,
    also: Callable[[WriteSession, StoredShape], object] | None = None,
    *,
    split: bool = False,
) -> list[StoredShape] | Kept:
    """Store a file as a shape, unless its collection has a shape with the same bytes, format and name.

    A shape that is there gets the new tags and metadata (`merged_fields`).

    Stages: look up the answer to a claim, and the shape; with `split`, read the distinct parts of the file,
    each of which becomes a shape after that of the whole; embed files in workers where needed; store bytes,
    shapes and embeddings in one transaction, with the answer to the claim and the changes that `also` makes.
    When this returns, all of them are durable and the next query finds the shapes. If the claim already has
    an answer, this returns the answer and stores nothing. If `also` raises, nothing is stored.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    IdempotencyKeyReusedError
        The key of the claim was used with another payload.
    BadRequestFieldsError, MeshError
        A part cannot be a shape; the message names the part.
    """
    timings = Timings()

    def look_up(session: ReadSession) -> list[StoredShape] | Kept | None:
        if claim is not None:
            return repository.kept_answer(session, claim, datetime.now(UTC))
        present = repository.same(session, new.collection, new, new.name)
        if present is None or not present.embedded or also is not None or split:
            return None
        return None if merged_fields(present, new) else [StoredShape(present, created=False)]

    def store(session: WriteSession, put: Put) -> list[StoredShape] | Kept:
        collections_repository.require(session, new.collection)
        now = datetime.now(UTC)
        # Another process, or a cancelled request, may have stored the answer meanwhile.
        kept = None if claim is None else repository.kept_answer(session, claim, now)
        if kept is not None:
            return kept
        stored = [put_shape(session, put, shape) for shape in shapes]
        if claim is not None:
            repository.keep_answer(session, claim, answer_of(stored, split=split), now)
        if also is not None:
            also(session, stored[0])
        return stored

    answer = await container.database.reading(look_up)
    if answer is not None:
        return answer
    shapes = [new]
    if split:
        with timings.stage("parts"):
            shapes += await _parts_of(container, new)
    stored, embedded = await store_files(container, shapes, store, timings)
    for stages in (timings.milliseconds, *(embedding.milliseconds for embedding in embedded)):
        container.metrics.stages("upload", stages)
    return stored


async def _parts_of(container: Container, whole: NewShape) -> list[NewShape]:
    """Read each distinct part of a file in a worker; return an empty list for a file without parts.

    A part is a 3MF in its own frame, with the tags and the metadata of the whole, and with `ASSEMBLY`, `PATH`
    and `INSTANCES`. Raise BadRequestFieldsError if the metadata have a key of the parts, or no room for them,
    and MeshError if the file cannot be read.
    """
    reserved = sorted({ASSEMBLY, PATH, INSTANCES} & whole.metadata.keys())
    if reserved:
        raise BadRequestFieldsError(
            FieldFault("metadata", f"with split=parts, the service sets {', '.join(reserved)}")
        )
    parts = await container.queue.parts(whole.data, whole.format)
    return [_shape_of(whole, part, number) for number, part in enumerate(parts, start=1)]


def _shape_of(whole: NewShape, part: PartFile, number: int) -> NewShape:
    """Return a part as a new shape, with its assembly before its name."""
    part_name = part.name or f"part {number}"
    path = "/".join(part.path)
    about = {ASSEMBLY: whole.name, PATH: path[-_PATH_CHARACTERS:], INSTANCES: part.instances}
    try:
        metadata = clean_metadata({**whole.metadata, **about})
    except ValueError as error:
        fault = FieldFault("metadata", f"with the metadata of the part {part_name!r}: {error}")
        raise BadRequestFieldsError(fault) from error
    name = clean_name(f"{whole.name[: NAME_CHARACTERS - len(part_name) - 1]}/{part_name}")
    return NewShape(part.data, _PART_FORMAT, whole.collection, name, whole.tags, metadata, is_part=True)


async def store_files(
    container: Container,
    files: Sequence[NewFile],
    change: Callable[[WriteSession, Put], T],
    timings: Timings | None = None,
) -> tuple[T, Collection[Embedded]]:
    """Embed files in workers where needed, and `change` the archive in one transaction.

    `change` gets a session, and a function that stores the bytes and the embedding of one of the files unless
    they are stored. If another pipeline becomes active meanwhile, all stages run again. If `change` raises,
    nothing is stored. Return the result of `change`, and the new embeddings.
    """
    timings = timings or Timings()
    while True:
        pipeline, missing = await container.database.reading(_look_up, container, files)
        embedded = await _embed(container, missing, pipeline)
        try:
            with timings.stage("store"):
                result = await run_in_threadpool(
                    _store, container.database, pipeline.fingerprint, files, embedded, change
                )
        except EmbeddingMissingError:
            continue
        return result, embedded.values()


def list_page(
    session: ReadSession, shapes: ShapeFilter, *, after: Position | None, limit: int, sort: Sort
) -> ShapePage:
    """Return one page of the shapes that match a filter, in an order."""
    rows, total = repository.page(session, shapes, after=after, limit=limit + 1, sort=sort)
    next_cursor = None
    if len(rows) > limit:
        last, _ = rows[limit - 1]
        next_cursor = write_cursor(last.number, last.name, last.points)
    page = [Shape.of(record) for _, record in rows[:limit]]
    return ShapePage(shapes=page, total=total, next_cursor=next_cursor)


def get(
    session: ReadSession, collection: CollectionNumber, shape_id: str, deleted: timedelta | None = None
) -> ShapeRecord:
    """Return the shape of a collection with an id; with `deleted`, a shape that was deleted in that time."""
    since = None if deleted is None else datetime.now(UTC) - deleted
    record = repository.by_id(session, collection, shape_id, since)
    if record is None:
        raise ShapeNotFoundError(shape_id)
    return record


def change(
    session: WriteSession,
    collection: CollectionNumber,
    shape_id: str,
    changes: ShapeChanges,
    target: CollectionNumber,
) -> ShapeRecord:
    """Change the name, tags or metadata of a shape, and move it to the collection `target`.

    Raise NameTakenError if another shape of the target has the name and the same file.
    """
    record = get(session, collection, shape_id)
    name = record.name if changes.name is None else changes.name
    holder = repository.same(session, target, record, name)
    if holder is not None and holder.id != shape_id:
        raise NameTakenError(f"another shape with the same file has the name {name!r}")
    if target != collection:
        repository.move_shape(session, record, target, name)
        record = get(session, target, shape_id)
    values = changes.model_dump(exclude_none=True, exclude={"collection"})
    if values:
        repository.change(session, record.number, values)
    return get(session, target, shape_id)


def delete(session: WriteSession, collection: CollectionNumber, shape_id: str, keep: timedelta) -> None:
    """Delete a shape, which can be restored during the time `keep`; with 0 it is erased at once."""
    record = get(session, collection, shape_id)
    if keep:
        repository.delete_shape(session, record)
    else:
        repository.erase_shape(session, record)


def list_deleted(
    session: ReadSession, collection: CollectionNumber, keep: timedelta, *, after: int, limit: int
) -> DeletedShapePage:
    """Return one page of a collection's shapes that can be restored, in the order of their deletion."""
    since = datetime.now(UTC) - keep
    rows = repository.deleted_page(session, collection, since, after=after, limit=limit + 1)
    return DeletedShapePage(
        shapes=[DeletedShape.of(record, keep) for _, record in rows[:limit]],
        total=repository.count_deleted(session, collection, since),
        undo_days=keep / timedelta(days=1),
        next_cursor=write_cursor(rows[limit - 1][0]) if len(rows) > limit else None,
    )


async def restore(
    container: Container, collection: CollectionNumber, shape_id: str, *, in_place: bool = False
) -> ShapeRecord:
    """Undo the deletion of a shape. Its bytes are stored unless they are `in_place`, in a folder that stays.

    Stages: read the file; embed it in a worker unless the active pipeline has embedded it; restore the shape
    in one transaction. Raise NameTakenError if a shape with the same bytes and name was stored meanwhile, and
    BadRecordError if the stored file is damaged.
    """
    keep = container.settings.undo_time

    def read(session: ReadSession) -> NewFile:
        record = get(session, collection, shape_id, deleted=keep)
        data = file_repository.file_of(session, collection, shape_id, deleted=True)
        return NewFile(data, record.format, in_place=in_place or is_in_source(session, record.sha256))

    def undo(session: WriteSession, put: Put) -> ShapeRecord:
        record = get(session, collection, shape_id, deleted=keep)
        put(file)
        holder = repository.same(session, collection, record, record.name)
        if holder is not None:
            raise NameTakenError(f"the same file was stored as {record.name!r} again: {holder.id}")
        repository.restore_shape(session, record)
        return get(session, collection, shape_id)

    file = await container.database.reading(read)
    return (await store_files(container, [file], undo))[0]


def purge(session: WriteSession, collection: CollectionNumber, shape_id: str, keep: timedelta) -> None:
    """Erase a deleted shape."""
    repository.erase_shape(session, get(session, collection, shape_id, deleted=keep))


def purge_old(database: Database, keep: timedelta) -> None:
    """Erase all deleted shapes whose time `keep` has passed."""
    moment = datetime.now(UTC) - keep
    with database.read() as session:
        if not repository.any_deleted_until(session, moment):
            return
    with database.write(deleting=True) as session:
        repository.erase_deleted_until(session, moment)


async def keep_purging(container: Container) -> None:
    """Call `purge_old` now and every ten minutes, until cancelled."""
    while True:
        try:
            await run_in_threadpool(purge_old, container.database, container.settings.undo_time)
        except ServiceError as error:
            log.warning("deleted shapes were not purged: %s", error)
        await asyncio.sleep(PURGE_SECONDS)


def answer_of(stored: Sequence[StoredShape], *, split: bool) -> Kept:
    """Return the answer to an upload: status 201 if a shape is new, 200 if all of them were there."""
    whole = stored[0]
    return Kept(
        status=201 if any(shape.created for shape in stored) else 200,
        location=f"/shapes/{whole.shape.id}",
        body=(Assembly.of_assembly(stored) if split else UploadedShape.of_stored(whole)).model_dump_json(),
    )


def put_shape(session: WriteSession, put: Put, new: NewShape) -> StoredShape:
    """Store a new shape; one that is stored gets its new tags and metadata."""
    file = put(new)
    present = None if file.created else repository.same(session, new.collection, new, new.name)
    if present is None:
        return StoredShape(repository.add_shape(session, file.blob_number, new, file.facts), created=True)
    fields = merged_fields(present, new)
    if not fields:
        return StoredShape(present, created=False)
    repository.change(session, present.number, fields)
    changed = get(session, new.collection, present.id)
    return StoredShape(
        changed, created=False, changed=tuple(name for name in ("tags", "metadata") if name in fields)
    )


def merged_fields(present: ShapeRecord, new: NewShape) -> dict[str, Any]:
    """Return the `tags` and `metadata` of a stored shape that an upload of the same file changes.

    New tags follow the tags that the shape has, and new keys of the metadata replace those it has. Raise
    BadRequestFieldsError if both together are more than a shape may have.
    """
    return changed_fields(present, [*present.tags, *new.tags], {**present.metadata, **new.metadata})


def changed_fields(record: ShapeRecord, tags: Iterable[str], metadata: dict[str, Any]) -> dict[str, Any]:
    """Return those of some new `tags`, each once, and `metadata` that a shape does not have.

    Raise BadRequestFieldsError if they are more than a shape may have.
    """
    distinct = list(dict.fromkeys(tags))
    fields: dict[str, Any] = {}
    if distinct != list(record.tags):
        fields["tags"] = _within_limits("tags", clean_tags, distinct)
    # Python takes 1 and true for equal.
    if json.dumps(metadata) != json.dumps(record.metadata):
        fields["metadata"] = _within_limits("metadata", clean_metadata, metadata)
    return fields


def _within_limits(field: str, clean: Callable[[T], T], value: T) -> T:
    """Return a joined field as `clean` returns it; raise BadRequestFieldsError if it refuses the field."""
    try:
        return clean(value)
    except ValueError as error:
        fault = FieldFault(field, f"with those of the stored shape: {error}")
        raise BadRequestFieldsError(fault) from error


def _look_up(
    session: ReadSession, container: Container, files: Sequence[NewFile]
) -> tuple[Pipeline, dict[FileKey, NewFile]]:
    """Return the active pipeline, and the files that need an embedding."""
    pipeline = container.pipelines.current(session).pipeline
    missing: dict[FileKey, NewFile] = {}
    for file in files:
        if not file_repository.is_embedded(session, pipeline.fingerprint, *file.key):
            missing.setdefault(file.key, file)
    return pipeline, missing


async def _embed(
    container: Container, files: Mapping[FileKey, NewFile], pipeline: Pipeline
) -> dict[FileKey, Embedded]:
    """Embed files, as many at a time as there are workers; the first error ends all."""
    free = asyncio.Semaphore(container.settings.workers)

    async def embed(file: NewFile) -> Embedded:
        async with free:
            try:
                return await container.queue.embed(file.data, file.format, pipeline)
            except (FileTimeLimitError, MeshError) as error:
                if not isinstance(file, NewShape) or not file.is_part:
                    raise
                raise type(error)(f"{file.name}: {error}") from error

    return dict(zip(files, await together(map(embed, files.values())), strict=True))


def _store(
    database: Database,
    fingerprint: str,
    files: Sequence[NewFile],
    embedded: Mapping[FileKey, Embedded],
    change: Callable[[WriteSession, Put], T],
) -> T:
    """Call `change` in a transaction; raise EmbeddingMissingError if a file must be embedded first."""
    with database.write() as session:
        if active_fingerprint(session) != fingerprint:
            raise EmbeddingMissingError
        return change(session, lambda file: _put_file(session, fingerprint, file, embedded.get(file.key)))


def _put_file(
    session: WriteSession, fingerprint: str, file: NewFile, embedded: Embedded | None
) -> StoredFile:
    """Store the bytes and the embedding of a file, unless they are stored."""
    blob_number = file_repository.blob_number(session, file.sha256)
    created = blob_number is None
    is_embedded = not created and file_repository.is_embedded(session, fingerprint, *file.key)
    if embedded is None and not is_embedded:
        raise EmbeddingMissingError
    if blob_number is None:
        blob_number = file_repository.add_blob(session, file.data, file.sha256, in_place=file.in_place)
    elif not file.in_place:
        file_repository.keep_bytes(session, blob_number, file.data)
    if embedded is None:
        facts = file_repository.facts_on(session, blob_number, file.format) or {}
        return StoredFile(blob_number, facts, created)
    if not is_embedded:
        file_repository.add_embedding(session, blob_number, file.format, fingerprint, embedded)
        if not created:
            repository.mark_changed(session, blob_number, file.format, embedded.facts)
    return StoredFile(blob_number, embedded.facts, created)
