"""Previews of comparisons, in which corresponding points have the same colour."""

from service.collection import CollectionNumber
from service.container import Container
from service.previews.service import record, stored_file
from service.rendering import tasks
from service.rendering.tasks import FACES, ComparedMesh
from service.search.records import Comparison


async def coloured(
    container: Container, collection: CollectionNumber, first_id: str, second_id: str, comparison: Comparison
) -> bytes:
    """Both shapes of a comparison as a GLB, coloured so that corresponding points have the same colour."""
    pairs = comparison.match.correspondence
    meshes = []
    for shape_id, embedding, samples in (
        (first_id, comparison.first, pairs[:, 0]),
        (second_id, comparison.second, pairs[:, 1]),
    ):
        shape = await record(container, collection, shape_id)
        points = embedding.positions[samples].astype("float64")
        mesh = await container.work.read(await stored_file(container, collection, shape_id), shape.format)
        meshes.append(ComparedMesh(shape.name, shape.format, mesh, points))
    return await container.work.do(tasks.coloured, meshes[0], meshes[1], FACES)
