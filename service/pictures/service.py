"""Pictures of stored shapes."""

from starlette.concurrency import run_in_threadpool

from service.errors import StorageFullError, StorageUnavailableError
from service.logging import get_logger
from service.parts import Parts
from service.pictures import repository, tasks
from service.pictures.tasks import FACES, Side
from service.pictures.thumbnail import DRAWING, draw
from service.pipelines.active import fingerprint
from service.search.records import Comparison
from service.sets.records import CollectionNumber
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord

log = get_logger("pictures")


async def record(parts: Parts, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """The shape of a collection with an id."""

    def read() -> ShapeRecord:
        with parts.database.read() as session:
            return shapes_service.get(session, fingerprint(session), collection, shape_id)

    return await run_in_threadpool(read)


async def thumbnail(parts: Parts, collection: CollectionNumber, shape: ShapeRecord, size: int) -> bytes:
    """The picture of a collection's shape that is stored, or else one drawn now, and stored."""

    def read() -> tuple[bytes | None, bytes]:
        with parts.database.read() as session:
            kept = repository.thumbnail(session, shape.sha256, shape.format, size, DRAWING)
            if kept is not None:
                return kept, b""
            return None, shapes_service.get_file(session, collection, shape.id)

    def keep(drawn: bytes) -> None:
        try:
            with parts.database.write() as session:
                repository.keep_thumbnail(session, shape.sha256, shape.format, size, DRAWING, drawn)
        except (StorageFullError, StorageUnavailableError) as error:
            log.warning("a thumbnail was drawn and not kept: %s", error)

    kept, data = await run_in_threadpool(read)
    if kept is not None:
        return kept
    with parts.work.admitted():
        mesh = await parts.work.read(data, shape.format)
        drawn = await parts.work.do(draw, mesh, shape.format, size)
    await run_in_threadpool(keep, drawn)
    return drawn


async def preview(parts: Parts, data: bytes, format: str) -> bytes:
    """A file's mesh as a GLB."""
    mesh = await parts.work.read(data, format)
    return await parts.work.do(tasks.preview, mesh, format, FACES)


async def stored_file(parts: Parts, collection: CollectionNumber, shape_id: str) -> bytes:
    """The bytes that were uploaded of a collection's shape."""

    def read() -> bytes:
        with parts.database.read() as session:
            return shapes_service.get_file(session, collection, shape_id)

    return await run_in_threadpool(read)


async def coloured(
    parts: Parts, collection: CollectionNumber, first_id: str, second_id: str, comparison: Comparison
) -> bytes:
    """Both shapes of a comparison as a GLB, painted so that points that correspond have one colour."""
    pairs = comparison.match.correspondence
    sides = []
    for shape_id, embedding, ends in (
        (first_id, comparison.first, pairs[:, 0]),
        (second_id, comparison.second, pairs[:, 1]),
    ):
        shape = await record(parts, collection, shape_id)
        points = embedding.positions[ends].astype("float64")
        mesh = await parts.work.read(await stored_file(parts, collection, shape_id), shape.format)
        sides.append(Side(shape.name, shape.format, mesh, points))
    return await parts.work.do(tasks.coloured, sides[0], sides[1], FACES)
