"""Thumbnails of stored shapes: drawn in a worker, and stored."""

from collections.abc import Mapping

from service.collection import CollectionNumber
from service.container import Container
from service.errors import StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger
from service.rendering.thumbnail import DRAWING, draw
from service.shapes import file_repository
from service.shapes.records import FileKey
from service.storage.database import WriteSession

log = get_logger("pictures")


async def draw_stored(
    container: Container, collection: CollectionNumber, shape_id: str, format: str, size: int
) -> bytes:
    """Draw the thumbnail of a stored shape, whose format is known, in a worker.

    Raise ShapeNotFoundError if the collection has no such shape, and BadRecordError or MeshError if the
    stored file is damaged, or cannot be read.
    """
    data = await container.database.reading(file_repository.file_of, collection, shape_id)
    mesh = await container.queue.read(data, format)
    return await container.queue.do(draw, mesh, format, size)


async def store(container: Container, drawn: Mapping[FileKey, bytes], size: int) -> None:
    """Store thumbnails of files; where the storage fails, they are drawn again another time."""

    def write(session: WriteSession) -> None:
        for (sha256, format), data in drawn.items():
            file_repository.store_thumbnail(session, sha256, format, size, DRAWING, data)

    if not drawn:
        return
    try:
        await container.database.writing(write)
    except (StorageFullError, StorageUnavailableError) as error:
        log.warning("thumbnails were drawn but not stored: %s", error)
