"""The map of the stored shapes: its layout, and one picture of all their thumbnails."""

import asyncio
import math
import time
from contextlib import suppress
from hashlib import sha256

import numpy as np

from core.errors import CoreError
from core.ranking.similarity_map import similarity_map
from service.collection import CollectionNumber
from service.compute.request_queue import together
from service.container import Container
from service.errors import ServiceError
from service.pipelines.active import ActivePipeline
from service.previews.thumbnails import draw_stored, store
from service.rendering.thumbnail import DRAWING, contact_sheet
from service.search import repository
from service.search.neighbours import rows_among
from service.search.repository import MappedShapes
from service.search.schemas import MOST_MAPPED, MapAnswer, MapShape
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes.records import FileKey, ShapeFilter
from service.storage.database import ReadSession

MOST_COLUMNS = 24
"""Columns of a sheet from which on its cells are 64 pixels wide, and not 128: at most 3,072 pixels in all."""

DRAWING_SECONDS = 2.0
"""The time after which a request begins no drawing of another missing thumbnail."""


def similarity_map_of(
    container: Container, shape_filter: ShapeFilter, active_pipeline: ActivePipeline
) -> MapAnswer:
    """Lay out the shapes that match a filter; of many, `MOST_MAPPED` are chosen evenly by age."""
    with container.database.read() as session:
        mapped, total = _mapped(session, shape_filter, active_pipeline.fingerprint)
        neighbours = rows_among(session, active_pipeline.fingerprint, mapped.numbers)
    laid_out = similarity_map(mapped.signatures, neighbours)
    places = laid_out.positions.tolist(), laid_out.cells.tolist()
    return MapAnswer(
        shapes=[
            MapShape(id=id, name=name, x=x, y=y, column=column, row=row)
            for id, name, (x, y), (column, row) in zip(mapped.ids, mapped.names, *places, strict=True)
        ],
        size=laid_out.size,
        total=total,
        version=version_of(mapped),
    )


async def map_sheet(
    container: Container, shape_filter: ShapeFilter, known: str | None, active_pipeline: ActivePipeline
) -> tuple[bytes | None, str, int]:
    """Draw the thumbnails of the shapes of a map into the cells of a square, row by row in their order.

    Thumbnails that are not stored are drawn for about `DRAWING_SECONDS`, and stored; the cells of others are
    transparent.

    Returns
    -------
    bytes or None
        A PNG; None if `known` is its tag.
    str
        The tag: the version of the map and the number of transparent cells.
    int
        The number of shapes whose thumbnails another request may draw.
    """
    mapped, _ = await container.database.reading(_mapped, shape_filter, active_pipeline.fingerprint)
    version = version_of(mapped)
    if known == f"{version}-0":
        return None, known, 0
    columns = math.ceil(math.sqrt(len(mapped.files)))
    side = 128 if columns <= MOST_COLUMNS else 64
    pictures = await container.database.reading(file_repository.thumbnails, mapped.files, side, DRAWING)
    missing = {key: id for key, id in zip(mapped.files, mapped.ids, strict=True) if key not in pictures}
    drawn, waiting = await _drawn(container, shape_filter.collection, missing, side)
    await store(container, drawn, side)
    cells = [(pictures | drawn).get(key) for key in mapped.files]
    png = await container.queue.do(contact_sheet, cells, columns, side)
    return png, f"{version}-{cells.count(None)}", waiting


async def _drawn(
    container: Container, collection: CollectionNumber, missing: dict[FileKey, str], side: int
) -> tuple[dict[FileKey, bytes], int]:
    """Draw files, given with the id of a shape; return the pictures, and the number of files not begun."""
    drawn: dict[FileKey, bytes] = {}
    begun, end = 0, time.monotonic() + DRAWING_SECONDS
    free = asyncio.Semaphore(container.settings.workers)

    async def draw(key: FileKey, shape_id: str) -> None:
        nonlocal begun
        async with free:
            if time.monotonic() < end:
                begun += 1
                # The shape was deleted meanwhile, or cannot be drawn now.
                with suppress(CoreError, ServiceError):
                    drawn[key] = await draw_stored(container, collection, shape_id, key[1], side)

    await together(draw(key, shape_id) for key, shape_id in missing.items())
    return drawn, len(missing) - begun


def _mapped(session: ReadSession, shape_filter: ShapeFilter, fingerprint: str) -> tuple[MappedShapes, int]:
    """Return the shapes of a map, and the number of all that match the filter."""
    numbers = np.sort(np.array(shapes_repository.numbers(session, shape_filter), dtype=np.int64))
    total = len(numbers)
    if total > MOST_MAPPED:
        numbers = numbers[np.arange(MOST_MAPPED) * total // MOST_MAPPED]
    return repository.map_shapes(session, fingerprint, numbers), total


def version_of(mapped: MappedShapes) -> str:
    """Return a digest of the pictures of a map."""
    files = "".join(f"{sha256} {format} " for sha256, format in mapped.files)
    return sha256(f"{DRAWING} {files}".encode()).hexdigest()[:32]
