"""Operations on shapes: store, list, read, change and delete."""

import asyncio
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from starlette.concurrency import run_in_threadpool

from core.pipeline import Pipeline
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.compute.tasks import Embedded
from service.container import Container
from service.errors import NameTakenError, ServiceError, ShapeNotFoundError
from service.http.idempotency import repository as idempotency
from service.http.idempotency.keys import Claim, Kept
from service.observability.logging import get_logger
from service.observability.timings import Timings
from service.pipelines.active import fingerprint as active_fingerprint
from service.shapes import file_repository, repository
from service.shapes.listing import Page, write_cursor, write_position
from service.shapes.records import (
    Changes,
    NewFile,
    NewShape,
    Position,
    ShapeFilter,
    ShapeRecord,
    Sort,
    StoredFile,
    StoredShape,
)
from service.shapes.schemas import Shape
from service.storage.database import Database, ReadSession, WriteSession

log = get_logger("shapes")

PURGE_SECONDS = 600.0


async def ingest(
    container: Container,
    new: NewShape,
    claim: Claim | None = None,
    also: Callable[[WriteSession, StoredShape], object] | None = None,
) -> StoredShape | Kept:
    """Store a file as a shape, unless its collection has a shape with the same bytes, format and name.

    Stages: look up the shape and its embedding; embed the file in a worker if needed; store bytes, shape and
    embedding in one transaction, with the answer to a claim and the changes that `also` makes. When this
    returns, all of them are durable and the next query finds the shape. If the claim already has an answer,
    this returns the answer and stores nothing. If `also` raises, nothing is stored.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    IdempotencyKeyReusedError
        The key of the claim was used with another payload.
    """
    timings = Timings()
    if claim is not None:
        kept = await run_in_threadpool(answer_to, container.database, claim)
        if kept is not None:
            return kept
    while True:
        pipeline, present, needed = await run_in_threadpool(_look_up, container, new)
        if present is not None and not needed and claim is None and also is None:
            return StoredShape(present, created=False)
        embedded = await container.queue.embed(new.data, new.format, pipeline) if needed else None
        with timings.stage("store"):
            stored = await run_in_threadpool(
                _store, container.database, pipeline.fingerprint, new, embedded, claim, also
            )
        if stored is not None:
            break
    made = {} if embedded is None else embedded.milliseconds
    container.metrics.stages("upload", {**made, **timings.milliseconds})
    return stored


def list_page(
    session: ReadSession,
    fingerprint: str,
    shapes: ShapeFilter,
    *,
    after: Position | None,
    limit: int,
    sort: Sort = "oldest",
) -> Page[ShapeRecord]:
    """Return one page of the shapes that match a filter, in an order."""
    records = repository.page(session, fingerprint, shapes, after=after, limit=limit + 1, sort=sort)
    total = repository.count(session, shapes)
    if len(records) <= limit:
        return Page(records, total, None)
    last = records[limit - 1]
    position = Position(last.number, last.name.casefold() if sort == "name" else None)
    return Page(records[:limit], total, write_position(position))


def get(session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """Return the shape of a collection with an id.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    record = repository.by_id(session, fingerprint, collection, shape_id)
    if record is None:
        raise ShapeNotFoundError(shape_id)
    return record


def change(
    session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str, changes: Changes
) -> ShapeRecord:
    """Change the name, tags or metadata of a shape.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    NameTakenError
        Another shape of the collection has the new name and the same file.
    """
    record = get(session, fingerprint, collection, shape_id)
    if changes == Changes():
        return record
    if changes.name is not None:
        holder = repository.same(session, fingerprint, collection, record, changes.name)
        if holder is not None and holder.id != shape_id:
            raise NameTakenError(f"another shape with the same file has the name {changes.name!r}")
    repository.change(session, record.number, changes)
    return get(session, fingerprint, collection, shape_id)


def delete(
    session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str, keep: timedelta
) -> None:
    """Delete a shape, which can be restored during the time `keep`; with 0 it is erased at once.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    record = get(session, fingerprint, collection, shape_id)
    if keep:
        repository.delete_shape(session, record)
    else:
        repository.erase_shape(session, record)


def list_deleted(
    session: ReadSession,
    fingerprint: str,
    collection: CollectionNumber,
    keep: timedelta,
    *,
    after: int,
    limit: int,
) -> Page[ShapeRecord]:
    """Return one page of a collection's shapes that can be restored, in the order of their deletion."""
    since = datetime.now(UTC) - keep
    rows = repository.deleted_page(session, fingerprint, collection, since, after=after, limit=limit + 1)
    total = repository.count_deleted(session, collection, since)
    next_cursor = write_cursor(rows[limit - 1][0]) if len(rows) > limit else None
    return Page([shape for _, shape in rows[:limit]], total, next_cursor)


async def restore(container: Container, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """Undo the deletion of a shape.

    Stages: read the file; embed it in a worker unless the active pipeline has embedded it; restore the shape
    in one transaction.

    Raises
    ------
    ShapeNotFoundError
        No deleted shape of the collection has the id, or its time has passed.
    NameTakenError
        A shape with the same bytes and name was stored meanwhile.
    BadRecordError
        The stored file is damaged.
    """
    keep = container.settings.undo_time

    def read(session: ReadSession, fingerprint: str) -> NewFile:
        record = get_deleted(session, fingerprint, collection, shape_id, keep)
        data = file_repository.file_of(session, collection, shape_id, deleted=True)
        assert data is not None
        return NewFile(data, record.format)

    def undo(session: WriteSession, fingerprint: str, file: StoredFile) -> ShapeRecord:
        record = get_deleted(session, fingerprint, collection, shape_id, keep)
        holder = repository.same(session, fingerprint, collection, record, record.name)
        if holder is not None:
            raise NameTakenError(f"the same file was stored as {record.name!r} again: {holder.id}")
        repository.restore_shape(session, record)
        return get(session, fingerprint, collection, shape_id)

    return await change_file(container, read, undo)


async def change_file(
    container: Container,
    read: Callable[[ReadSession, str], NewFile],
    change: Callable[[WriteSession, str, StoredFile], ShapeRecord],
) -> ShapeRecord:
    """Give a shape a file.

    Stages: `read` the file; embed it in a worker if needed; store the file and `change` the shape in one
    transaction. If another pipeline becomes active meanwhile, all stages run again. The functions get the
    fingerprint of the active pipeline; what they raise ends the operation, and nothing is stored.
    """

    def look_up() -> tuple[Pipeline, NewFile, bool]:
        with container.database.read() as session:
            pipeline = container.pipelines.current(session).pipeline
            file = read(session, pipeline.fingerprint)
            key = pipeline.fingerprint, file.sha256, file.format
            return pipeline, file, not file_repository.is_embedded(session, *key)

    def store(file: NewFile, fingerprint: str, embedded: Embedded | None) -> ShapeRecord | None:
        with container.database.write() as session:
            stored = put_file(session, fingerprint, file, embedded)
            return None if stored is None else change(session, fingerprint, stored)

    while True:
        pipeline, file, needed = await run_in_threadpool(look_up)
        embedded = await container.queue.embed(file.data, file.format, pipeline) if needed else None
        changed = await run_in_threadpool(store, file, pipeline.fingerprint, embedded)
        if changed is not None:
            return changed


def get_deleted(
    session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str, keep: timedelta
) -> ShapeRecord:
    """Return the deleted shape of a collection with an id.

    Raises
    ------
    ShapeNotFoundError
        No deleted shape has the id, or the time `keep` has passed.
    """
    since = datetime.now(UTC) - keep
    record = repository.deleted_by_id(session, fingerprint, collection, shape_id, since)
    if record is None:
        raise ShapeNotFoundError(shape_id)
    return record


def purge(
    session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str, keep: timedelta
) -> None:
    """Erase a deleted shape. It raises the errors of `get_deleted`."""
    repository.erase_shape(session, get_deleted(session, fingerprint, collection, shape_id, keep))


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


def _look_up(container: Container, new: NewShape) -> tuple[Pipeline, ShapeRecord | None, bool]:
    """Return the active pipeline, the shape if it is stored, and whether the file needs an embedding."""
    with container.database.read() as session:
        pipeline = container.pipelines.current(session).pipeline
        present = repository.same(session, pipeline.fingerprint, new.collection, new, new.name)
        needed = not file_repository.is_embedded(session, pipeline.fingerprint, new.sha256, new.format)
        return pipeline, present, needed


def _store(
    database: Database,
    fingerprint: str,
    new: NewShape,
    embedded: Embedded | None,
    claim: Claim | None,
    also: Callable[[WriteSession, StoredShape], object] | None,
) -> StoredShape | Kept | None:
    """Store a new shape in one transaction; None if the file must be embedded first.

    That happens if another pipeline became active, or if the embedding was deleted with its last shape.
    """
    with database.write() as session:
        collections_repository.require(session, new.collection)
        now = datetime.now(UTC)
        # Another process, or a cancelled request, may have stored the answer meanwhile.
        kept = None if claim is None else idempotency.answer_to(session, claim, now)
        if kept is not None:
            return kept
        stored = put_shape(session, fingerprint, new, embedded)
        if stored is None:
            return None
        if claim is not None:
            idempotency.keep(session, claim, answer_of(stored), now)
        if also is not None:
            also(session, stored)
        return stored


def answer_of(stored: StoredShape) -> Kept:
    """Return the answer to an upload: status 201 for a new shape, 200 for an existing one."""
    return Kept(
        status=201 if stored.created else 200,
        location=f"/shapes/{stored.shape.id}",
        body=Shape.of(stored.shape).model_dump_json(),
    )


def answer_to(database: Database, claim: Claim) -> Kept | None:
    """Return the answer that an earlier request with the key had; None if there was none."""
    with database.read() as session:
        return idempotency.answer_to(session, claim, datetime.now(UTC))


def put_shape(
    session: WriteSession, fingerprint: str, new: NewShape, embedded: Embedded | None
) -> StoredShape | None:
    """Store a new shape, unless it is stored; None if its file has no embedding, as in `put_file`."""
    put = put_file(session, fingerprint, new, embedded)
    if put is None:
        return None
    present = None if put.created else repository.same(session, fingerprint, new.collection, new, new.name)
    if present is not None:
        return StoredShape(present, created=False)
    return StoredShape(repository.add_shape(session, put.blob_number, new, put.facts), created=True)


def put_file(
    session: WriteSession, fingerprint: str, file: NewFile, embedded: Embedded | None
) -> StoredFile | None:
    """Store the bytes and the embedding of a file, unless they are stored.

    None if the file has no embedding: it was deleted after the lookup, or another pipeline became active.
    """
    if active_fingerprint(session) != fingerprint:
        return None
    blob_number = file_repository.blob_number(session, file.sha256)
    created = blob_number is None
    is_embedded = not created and file_repository.is_embedded(session, fingerprint, file.sha256, file.format)
    if embedded is None and not is_embedded:
        return None
    if blob_number is None:
        blob_number = file_repository.add_blob(session, file.data, file.sha256)
    if embedded is None:
        facts = file_repository.facts_on(session, blob_number, file.format) or {}
        return StoredFile(blob_number, facts, created)
    if not is_embedded:
        file_repository.add_embedding(session, blob_number, file.format, fingerprint, embedded)
        if not created:
            repository.mark_changed(session, blob_number, file.format, embedded.facts)
    return StoredFile(blob_number, embedded.facts, created)
