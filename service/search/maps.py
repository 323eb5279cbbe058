"""The address /map: positions of stored shapes by their signatures."""

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool

from core.ranking.similarity_map import similarity_map
from service.collections.dependencies import InCollection, NamedInAddress
from service.container import Container
from service.dependencies import Service
from service.http.middleware import while_connected
from service.http.problems import documented
from service.http.request_bodies import once_each
from service.pipelines.active import ActivePipeline
from service.search.answer import with_active_pipeline
from service.search.repository import map_shapes
from service.search.schemas import MOST_MAPPED, MapAnswer, MapShape
from service.shapes import repository as shapes_repository
from service.shapes.listing import Filters
from service.shapes.records import ShapeFilter

router = APIRouter(tags=["search"])


class MapOptions(NamedInAddress, Filters):
    """The shapes of a map."""


@router.get(
    "/map",
    summary="Lay shapes out by similarity",
    dependencies=[once_each(MapOptions)],
    responses=documented(
        "bad-request-fields",
        "busy",
        "shutting-down",
        "pipeline-unavailable",
        "storage-unavailable",
    ),
)
async def read_map(
    options: Annotated[MapOptions, Query()], request: Request, container: Service, collection: InCollection
) -> MapAnswer:
    """Return positions of the stored shapes on a plane: the principal components of their signatures.

    Similar shapes are near each other; shapes that are near each other may differ. Equal shapes give equal
    maps.
    """
    shape_filter = options.filtered(collection.number)

    async def lay_out(active_pipeline: ActivePipeline) -> MapAnswer:
        return await run_in_threadpool(_lay_out, container, shape_filter, active_pipeline.fingerprint)

    with container.queue.admitted():
        return await while_connected(request, with_active_pipeline(container, lay_out))


def _lay_out(container: Container, shape_filter: ShapeFilter, fingerprint: str) -> MapAnswer:
    """Lay out the shapes that match a filter; of many, `MOST_MAPPED` are chosen evenly by age."""
    with container.database.read() as session:
        numbers = np.sort(np.array(shapes_repository.numbers(session, shape_filter), dtype=np.int64))
        total = len(numbers)
        if total > MOST_MAPPED:
            numbers = numbers[np.arange(MOST_MAPPED) * total // MOST_MAPPED]
        ids, names, signatures = map_shapes(session, fingerprint, numbers)
    laid_out = similarity_map(signatures)
    rows = zip(ids, names, laid_out.positions.tolist(), laid_out.cells.tolist(), strict=True)
    return MapAnswer(
        shapes=[
            MapShape(id=id, name=name, x=x, y=y, column=column, row=row)
            for id, name, (x, y), (column, row) in rows
        ],
        size=laid_out.size,
        total=total,
    )
