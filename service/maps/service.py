"""Maps of a collection."""

from dataclasses import dataclass

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.arrays import Ints
from core.ranking.similarity_map import SimilarityMap
from service.container import Container
from service.maps import tasks
from service.maps.repository import MapShapes, map_shapes
from service.pipelines.active import ActivePipeline
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter

MOST = 2000
"""Most shapes of a map; the document of the interface names it."""


@dataclass(frozen=True, eq=False)
class CollectionMap:
    """A map, its shapes in the same order, and the number of shapes that match the filter."""

    map: SimilarityMap
    shapes: MapShapes
    total: int


async def find(container: Container, wanted: ShapeFilter, active_pipeline: ActivePipeline) -> CollectionMap:
    """The map of the shapes that match a filter; of many, `MOST` are chosen evenly by age.

    A map depends on the embeddings alone, so it is kept by their numbers.
    """

    def read() -> tuple[MapShapes, int]:
        with container.database.read() as session:
            numbers = np.sort(np.array(shapes_repository.numbers(session, wanted), dtype=np.int64))
            return map_shapes(session, active_pipeline.fingerprint, evenly(numbers)), len(numbers)

    shapes, total = await run_in_threadpool(read)
    found = container.maps.get(shapes.embeddings)
    if found is None:
        parameters = active_pipeline.pipeline.parameters
        found = await container.queue.do(tasks.lay_out, shapes.descriptors, parameters)
        container.maps.put(shapes.embeddings, found)
    return CollectionMap(found, shapes, total)


def evenly(numbers: Ints) -> Ints:
    """At most `MOST` of some numbers, evenly spaced in their order."""
    if len(numbers) <= MOST:
        return numbers
    return np.asarray(numbers[np.arange(MOST) * len(numbers) // MOST])
