"""Deletion of shapes that can be restored for some time."""

import asyncio
from datetime import UTC, datetime, timedelta

from starlette.concurrency import run_in_threadpool

from service.collection import CollectionNumber
from service.container import Container
from service.errors import NameTakenError, ServiceError, ShapeNotFoundError
from service.observability.logging import get_logger
from service.shapes import service as shapes_service
from service.shapes.deleted import repository
from service.shapes.deleted.records import DeletedPage, DeletedRecord
from service.shapes.records import NewShape, ShapeRecord, StoredShape
from service.storage.database import Database, ReadSession, WriteSession

log = get_logger("deleted")

PURGE_SECONDS = 600.0


def delete(
    session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str, keep: timedelta
) -> None:
    """Delete a shape, which can be restored during the time `keep`; with 0 it is erased at once.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    record = shapes_service.get(session, fingerprint, collection, shape_id)
    if keep:
        repository.keep(session, collection, record, datetime.now(UTC))
    shapes_service.remove(session, fingerprint, collection, shape_id)


def list_page(
    session: ReadSession, collection: CollectionNumber, keep: timedelta, *, after: int, limit: int
) -> DeletedPage:
    """One page of a collection's shapes that can be restored, in the order of their deletion."""
    since = datetime.now(UTC) - keep
    found = repository.page(session, collection, since, after=after, limit=limit + 1)
    more = len(found) > limit
    found = found[:limit]
    total = repository.count(session, collection, since)
    return DeletedPage(found, total, found[-1].number if more else None)


def get(session: ReadSession, collection: CollectionNumber, shape_id: str, keep: timedelta) -> DeletedRecord:
    """The deleted shape of a collection with an id.

    Raises
    ------
    ShapeNotFoundError
        No deleted shape has the id, or the time `keep` has passed.
    """
    record = repository.by_id(session, collection, shape_id, datetime.now(UTC) - keep)
    if record is None:
        raise ShapeNotFoundError(shape_id)
    return record


async def restore(container: Container, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """Store a deleted shape again, under its id.

    Its file is embedded unless another shape has the same file.

    Raises
    ------
    NameTakenError
        A shape with the same bytes and name was stored meanwhile.
    """
    keep = container.settings.undo_time

    def read() -> tuple[DeletedRecord, bytes]:
        with container.database.read() as session:
            record = get(session, collection, shape_id, keep)
            return record, repository.data_of(session, record.number) or b""

    record, data = await run_in_threadpool(read)
    new = NewShape(
        data,
        record.format,
        collection,
        record.name,
        record.tags,
        record.metadata,
        record.id,
        record.created_at,
    )

    def undone(session: WriteSession, stored: StoredShape) -> None:
        if not repository.remove(session, record.number):
            raise ShapeNotFoundError(shape_id)
        if not stored.created:
            raise NameTakenError(f"the same file was stored as {record.name!r} again: {stored.shape.id}")

    done = await shapes_service.ingest(container, new, also=undone)
    assert isinstance(done, StoredShape)
    return done.shape


def purge(session: WriteSession, collection: CollectionNumber, shape_id: str, keep: timedelta) -> None:
    """Erase a deleted shape.

    Raises
    ------
    ShapeNotFoundError
        No deleted shape has the id, or the time `keep` has passed.
    """
    repository.remove(session, get(session, collection, shape_id, keep).number)


def purge_old(database: Database, keep: timedelta) -> None:
    """Erase all deleted shapes whose time `keep` has passed."""
    moment = datetime.now(UTC) - keep
    with database.read() as session:
        if not repository.any_until(session, moment):
            return
    with database.write(deleting=True) as session:
        repository.remove_until(session, moment)


async def keep_purging(container: Container) -> None:
    """Call `purge_old` now and every ten minutes, until cancelled."""
    while True:
        try:
            await run_in_threadpool(purge_old, container.database, container.settings.undo_time)
        except ServiceError as error:
            log.warning("deleted shapes were not purged: %s", error)
        await asyncio.sleep(PURGE_SECONDS)
