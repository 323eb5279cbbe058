"""Pictures of stored shapes."""

from starlette.concurrency import run_in_threadpool

from service.collection import CollectionNumber
from service.container import Container
from service.errors import StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger
from service.pipelines.active import fingerprint
from service.previews import repository
from service.rendering import tasks
from service.rendering.tasks import FACES
from service.rendering.thumbnail import DRAWING, draw
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord

log = get_logger("pictures")


async def record(container: Container, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """The shape of a collection with an id."""

    def read() -> ShapeRecord:
        with container.database.read() as session:
            return shapes_service.get(session, fingerprint(session), collection, shape_id)

    return await run_in_threadpool(read)


async def thumbnail(
    container: Container, collection: CollectionNumber, shape: ShapeRecord, size: int
) -> bytes:
    """The picture of a collection's shape that is stored, or else one drawn now, and stored."""

    def read() -> tuple[bytes | None, bytes]:
        with container.database.read() as session:
            kept = repository.thumbnail(session, shape.sha256, shape.format, size, DRAWING)
            if kept is not None:
                return kept, b""
            return None, shapes_service.get_file(session, collection, shape.id)

    def keep(drawn: bytes) -> None:
        try:
            with container.database.write() as session:
                repository.keep_thumbnail(session, shape.sha256, shape.format, size, DRAWING, drawn)
        except (StorageFullError, StorageUnavailableError) as error:
            log.warning("a thumbnail was drawn and not kept: %s", error)

    kept, data = await run_in_threadpool(read)
    if kept is not None:
        return kept
    with container.work.admitted():
        mesh = await container.work.read(data, shape.format)
        drawn = await container.work.do(draw, mesh, shape.format, size)
    await run_in_threadpool(keep, drawn)
    return drawn


async def preview(container: Container, data: bytes, format: str) -> bytes:
    """A file's mesh as a GLB."""
    mesh = await container.work.read(data, format)
    return await container.work.do(tasks.preview, mesh, format, FACES)


async def stored_file(container: Container, collection: CollectionNumber, shape_id: str) -> bytes:
    """The bytes that were uploaded of a collection's shape."""

    def read() -> bytes:
        with container.database.read() as session:
            return shapes_service.get_file(session, collection, shape_id)

    return await run_in_threadpool(read)
