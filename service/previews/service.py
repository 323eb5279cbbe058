"""Thumbnails and previews of stored shapes."""

from starlette.concurrency import run_in_threadpool

from service.collection import CollectionNumber
from service.container import Container
from service.errors import StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger
from service.rendering import tasks
from service.rendering.tasks import FACES
from service.rendering.thumbnail import DRAWING, draw
from service.shapes import file_repository, file_service
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord

log = get_logger("pictures")


async def record(container: Container, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """Return the record of a shape.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """

    def read() -> ShapeRecord:
        with container.database.read() as session:
            return shapes_service.get(session, collection, shape_id)

    return await run_in_threadpool(read)


async def thumbnail(
    container: Container, collection: CollectionNumber, shape: ShapeRecord, size: int
) -> bytes:
    """Return the stored thumbnail of a shape. A missing one is drawn in a worker and stored."""

    def read() -> tuple[bytes | None, bytes]:
        with container.database.read() as session:
            stored = file_repository.thumbnail(session, shape.sha256, shape.format, size, DRAWING)
            if stored is not None:
                return stored, b""
            return None, file_service.get_file(session, collection, shape.id)

    def store(drawn: bytes) -> None:
        try:
            with container.database.write() as session:
                file_repository.store_thumbnail(session, shape.sha256, shape.format, size, DRAWING, drawn)
        except (StorageFullError, StorageUnavailableError) as error:
            log.warning("a thumbnail was drawn but not stored: %s", error)

    stored, data = await run_in_threadpool(read)
    if stored is not None:
        return stored
    with container.queue.admitted():
        mesh = await container.queue.read(data, shape.format)
        drawn = await container.queue.do(draw, mesh, shape.format, size)
    await run_in_threadpool(store, drawn)
    return drawn


async def preview(container: Container, data: bytes, format: str) -> bytes:
    """Return the mesh of a file as a GLB, made in a worker."""
    mesh = await container.queue.read(data, format)
    return await container.queue.do(tasks.preview, mesh, format, FACES)


async def stored_file(container: Container, collection: CollectionNumber, shape_id: str) -> bytes:
    """Return the uploaded bytes of a shape.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """

    def read() -> bytes:
        with container.database.read() as session:
            return file_service.get_file(session, collection, shape_id)

    return await run_in_threadpool(read)
