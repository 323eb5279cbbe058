"""Both shapes of a comparison, painted so that points that correspond have one colour."""

from service.collection import CollectionNumber
from service.container import Container
from service.previews.service import record, stored_file
from service.rendering import tasks
from service.rendering.tasks import FACES, Side
from service.search.records import Comparison


async def coloured(
    container: Container, collection: CollectionNumber, first_id: str, second_id: str, comparison: Comparison
) -> bytes:
    """Both shapes of a comparison as a GLB, painted so that points that correspond have one colour."""
    pairs = comparison.match.correspondence
    sides = []
    for shape_id, embedding, ends in (
        (first_id, comparison.first, pairs[:, 0]),
        (second_id, comparison.second, pairs[:, 1]),
    ):
        shape = await record(container, collection, shape_id)
        points = embedding.positions[ends].astype("float64")
        mesh = await container.work.read(await stored_file(container, collection, shape_id), shape.format)
        sides.append(Side(shape.name, shape.format, mesh, points))
    return await container.work.do(tasks.coloured, sides[0], sides[1], FACES)
