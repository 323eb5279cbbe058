"""The two shapes of a comparison: stored shapes, and files that are sent with the request."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from fastapi import UploadFile
from starlette.concurrency import run_in_threadpool

from core.embedding import DenseCorrespondence
from core.io import format_of
from core.mesh.mesh import Mesh
from service.collection import CollectionNumber
from service.compute.tasks import embed_mesh
from service.container import Container
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import tasks
from service.search.likeness import once, stored_mesh
from service.shapes import file_service
from service.shapes import service as shapes_service
from service.shapes.fields import base_name


@dataclass(frozen=True, eq=False)
class ComparedShape:
    """One of two shapes that are compared.

    Attributes
    ----------
    name, format : str
        The name of the shape and the format of its file.
    record : bytes
        Its embedding by the active pipeline.
    mesh : callable
        Reads its mesh, once.
    """

    name: str
    format: str
    record: bytes
    mesh: Callable[[], Awaitable[Mesh]]


async def compared_shape(
    container: Container,
    collection: CollectionNumber,
    given: str | UploadFile,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> ComparedShape:
    """The shape of a collection with an id, or the shape of a file.

    Raises
    ------
    ShapeNotFoundError, NotEmbeddedError
        The collection has no such shape, or no embedding of it.
    MeshError
        The file cannot be used; the subclass says why.
    """
    if isinstance(given, str):
        with timings.stage("read"):
            return await _stored(container, collection, given, active_pipeline)
    return await _sent(container, given, active_pipeline, timings)


async def correspondences(
    container: Container,
    first: ComparedShape,
    second: ComparedShape,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> tuple[DenseCorrespondence, DenseCorrespondence]:
    """The dense correspondence from the first shape to the second, and from the second to the first."""
    with timings.stage("dense"):
        meshes = await asyncio.gather(first.mesh(), second.mesh())
        parameters = active_pipeline.pipeline.parameters
        return await container.queue.do(
            tasks.dense_correspondence, *meshes, first.record, second.record, parameters
        )


async def _stored(
    container: Container, collection: CollectionNumber, shape_id: str, active_pipeline: ActivePipeline
) -> ComparedShape:
    fingerprint = active_pipeline.fingerprint

    async def mesh() -> Mesh:
        return await stored_mesh(container, collection, shape_id)

    def read() -> ComparedShape:
        with container.database.read() as session:
            record = file_service.get_record(session, fingerprint, collection, shape_id)
            shape = shapes_service.get(session, fingerprint, collection, shape_id)
            return ComparedShape(shape.name, shape.format, record, once(mesh))

    return await run_in_threadpool(read)


async def _sent(
    container: Container, file: UploadFile, active_pipeline: ActivePipeline, timings: Timings
) -> ComparedShape:
    name = file.filename or ""
    mesh_format = format_of(name)
    await file.seek(0)
    data = await file.read()
    with timings.stage("embed"):
        mesh = await container.queue.read(data, mesh_format)
        embedded = await container.queue.do(embed_mesh, mesh, active_pipeline.pipeline.parameters, 0.0)

    async def kept() -> Mesh:
        return mesh

    return ComparedShape(base_name(name), mesh_format, embedded.record, kept)
