"""The address /map."""

from typing import Annotated

from fastapi import APIRouter, Query, Request

from service.collections.dependencies import InCollection, NamedInAddress
from service.dependencies import Service
from service.http.disconnects import while_connected
from service.http.duplicate_parameters import once_each
from service.http.problems import documented
from service.maps import service
from service.maps.schemas import MapAnswer
from service.maps.service import CollectionMap
from service.pipelines.active import ActivePipeline
from service.search.service import in_one_pipeline
from service.shapes.filters import Filters

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
        "worker-lost",
        "cluster-unavailable",
        "time-limit",
        "pipeline-unavailable",
        "storage-unavailable",
    ),
)
async def read_map(
    options: Annotated[MapOptions, Query()], request: Request, container: Service, collection: InCollection
) -> MapAnswer:
    """Positions of the stored shapes on a plane, by t-SNE of the approximate log odds of pairs.

    Similar shapes are near each other; distances between far shapes have no meaning. Equal shapes give equal
    maps. The first map of 2,000 shapes takes seconds; later ones of the same shapes are kept.
    """
    wanted = options.filtered(collection.number)

    async def found(active_pipeline: ActivePipeline) -> CollectionMap:
        return await service.find(container, wanted, active_pipeline)

    with container.queue.admitted():
        return MapAnswer.of(await while_connected(request, in_one_pipeline(container, found)))
