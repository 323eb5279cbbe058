"""The likeness of stored shapes to a query: rigid copies are confirmed by registration."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial

from starlette.concurrency import run_in_threadpool

from core.embedding import Embedding
from core.errors import BadRecordError, CoreError
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.ranking.likeness import likeness
from core.ranking.shortlist import spectral_distances
from core.registration.rigid_copy import RigidCopy, copy_by_samples, may_be_copy
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.container import Container
from service.errors import NotEmbeddedError, ServiceError, ShapeNotFoundError
from service.observability.logging import get_logger
from service.search import tasks
from service.search.records import Comparison, Query, Relation, SearchResult
from service.shapes import file_service
from service.shapes import repository as shapes_repository

log = get_logger("likeness")

MOST_FACES = 20_000
"""Most faces of a mesh that is registered; larger meshes are copies by the samples of their records alone."""

ReadMesh = Callable[[], Awaitable[Mesh]]


@dataclass(frozen=True, eq=False)
class _Side:
    """A shape that may be a copy: its embedding, the record of this, and its mesh, if it may be read."""

    embedding: Embedding
    record: bytes
    mesh: ReadMesh | None

    @property
    def radius(self) -> float:
        """Root mean square distance of the surface from its centroid over the root of its area."""
        return float(self.embedding.facts.scale / self.embedding.facts.area**0.5)

    @property
    def is_small(self) -> bool:
        """Whether the mesh is registered."""
        return self.embedding.facts.faces <= MOST_FACES


async def stored_mesh(container: Container, collection: CollectionNumber, shape_id: str) -> Mesh:
    """The mesh of a shape, read from its file.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """

    def read() -> tuple[bytes, str]:
        with container.database.read() as session:
            shape = shapes_repository.by_id(session, "", collection, shape_id)
            if shape is None:
                raise ShapeNotFoundError(shape_id)
            return file_service.get_file(session, collection, shape_id), shape.format

    return await container.queue.read(*await run_in_threadpool(read))


async def relations_of(
    container: Container, query: Query, collection: CollectionNumber, found: Sequence[SearchResult]
) -> list[Relation]:
    """The relation of each result to the query.

    Only results whose eigenvalues and area allow it are registered. The file of the query is read once.
    """
    parameters = query.active_pipeline.pipeline.parameters
    first = _Side(query.embedding, query.record, None if query.mesh is None else once(query.mesh))
    relations = []
    for one in found:
        copy = None
        if may_be_copy(one.spectral, first.radius, one.shape.facts["scale"] / one.shape.facts["area"] ** 0.5):
            second = await _stored(container, query, collection, one.shape.id)
            copy = None if second is None else await _copy(container, first, second, one.spectral, parameters)
        probability = max(one.combined, one.typical_probability)
        relations.append(_relation(one.spectral, one.cc, probability, copy))
    return relations


async def relation_of(
    container: Container,
    comparison: Comparison,
    typical_probability: float,
    records: Sequence[bytes],
    meshes: Sequence[ReadMesh],
) -> Relation:
    """The relation of the second of two compared shapes to the first.

    Parameters
    ----------
    container : Container
    comparison : Comparison
    typical_probability : float
        Their class probability at the typical density of shapes.
    records : sequence of bytes
        The records of both embeddings.
    meshes : sequence of callables
        They read the two meshes.
    """
    parameters = comparison.pipeline.parameters
    first = _Side(comparison.first, records[0], meshes[0])
    second = _Side(comparison.second, records[1], meshes[1])
    spectral = float(spectral_distances(first.embedding.signature, second.embedding.signature[None])[0])
    copy = None
    if may_be_copy(spectral, first.radius, second.radius):
        copy = await _copy(container, first, second, spectral, parameters)
    probability = max(comparison.combined, typical_probability)
    return _relation(spectral, comparison.match.cc, probability, copy)


async def _stored(
    container: Container, query: Query, collection: CollectionNumber, shape_id: str
) -> _Side | None:
    """A stored shape; None if it was deleted meanwhile, or its record cannot be read."""

    def read() -> _Side:
        with container.database.read() as session:
            record = file_service.get_record(session, query.active_pipeline.fingerprint, collection, shape_id)
        mesh = partial(stored_mesh, container, collection, shape_id)
        return _Side(embedding_from_bytes(record), record, mesh)

    try:
        return await run_in_threadpool(read)
    except (BadRecordError, NotEmbeddedError, ShapeNotFoundError) as error:
        log.warning("a result is not registered: %s", error)
        return None


async def _copy(
    container: Container, first: _Side, second: _Side, spectral: float, parameters: Parameters
) -> RigidCopy | None:
    """A rigid copy or a variant: by the samples of the records, else by the surfaces of small meshes."""
    copy = copy_by_samples(first.embedding, second.embedding, spectral)
    if copy is not None or first.mesh is None or second.mesh is None:
        return copy
    if not (first.is_small and second.is_small):
        return None
    try:
        meshes = await asyncio.gather(first.mesh(), second.mesh())
        return await container.queue.do(tasks.registered, *meshes, first.record, second.record, parameters)
    except (CoreError, ServiceError) as error:
        log.warning("a result is not registered: %s", error)
        return None


def _relation(spectral: float, cc: float, probability: float, copy: RigidCopy | None) -> Relation:
    told = likeness(
        spectral=spectral,
        cc=cc,
        probability=probability,
        scale=None if copy is None else copy.scale,
        mirrored=copy is not None and copy.mirrored,
        variant=copy is not None and copy.difference is not None,
    )
    return Relation(told) if copy is None else Relation(told, copy.scale, copy.difference)


def once(read: ReadMesh) -> ReadMesh:
    """A function that reads a mesh at its first call and keeps it."""
    meshes: list[Mesh] = []

    async def kept() -> Mesh:
        if not meshes:
            meshes.append(await read())
        return meshes[0]

    return kept
