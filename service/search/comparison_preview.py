"""Previews of comparisons: both meshes painted, as a GLB or a picture."""

import asyncio

from core.embedding import DenseCorrespondence
from service.container import Container
from service.rendering import tasks
from service.rendering.colours import Paint
from service.rendering.tasks import FACES, ComparedMesh, PaintedMesh
from service.search.compared_shapes import ComparedShape
from service.search.records import Comparison

PICTURE_SIZE = 512
"""Height of the picture of a comparison, in pixels."""


async def coloured(
    container: Container, first: ComparedShape, second: ComparedShape, comparison: Comparison
) -> bytes:
    """Both shapes, coloured so that corresponding points have the same colour."""
    pairs = comparison.match.correspondence
    meshes = []
    for shape, embedding, samples in (
        (first, comparison.first, pairs[:, 0]),
        (second, comparison.second, pairs[:, 1]),
    ):
        points = embedding.positions[samples].astype("float64")
        meshes.append(ComparedMesh(shape.name, shape.format, await shape.mesh(), points))
    return await container.queue.do(tasks.coloured, meshes[0], meshes[1], FACES)


async def painted(
    container: Container,
    first: ComparedShape,
    second: ComparedShape,
    ways: tuple[DenseCorrespondence, DenseCorrespondence],
    paint: Paint,
    *,
    picture: bool,
) -> bytes:
    """Both shapes, painted vertex by vertex from their dense correspondence: a GLB, or a picture."""
    meshes = await asyncio.gather(first.mesh(), second.mesh())
    one, other = (
        PaintedMesh(shape.name, shape.format, mesh, way)
        for shape, mesh, way in zip((first, second), meshes, ways, strict=True)
    )
    if picture:
        return await container.queue.do(tasks.painted_picture, one, other, FACES, paint, PICTURE_SIZE)
    return await container.queue.do(tasks.painted, one, other, FACES, paint)
