"""The likeness of stored shapes to a query: rigid copies are confirmed by registration."""

import asyncio
from collections.abc import Sequence
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
from service.compute import tasks
from service.container import Container
from service.errors import ServiceError, ShapeNotFoundError
from service.observability.logging import get_logger
from service.search.records import Comparison, Query, ReadMesh, Relation, SearchResult
from service.shapes import file_service
from service.shapes import repository as shapes_repository

log = get_logger("likeness")

MOST_FACES = 20_000
"""Most faces of a mesh that is registered; larger meshes are copies by the samples of their records alone."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface that may be a copy: its embedding, the record of this, and its mesh, if it may be read."""

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
    """Read the mesh of a shape from its file.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """

    def read() -> tuple[bytes, str]:
        with container.database.read() as session:
            shape = shapes_repository.by_id(session, collection, shape_id)
            if shape is None:
                raise ShapeNotFoundError(shape_id)
            return file_service.get_file(session, collection, shape_id), shape.format

    return await container.queue.read(*await run_in_threadpool(read))


async def relations_of(
    container: Container, query: Query, collection: CollectionNumber, results: Sequence[SearchResult]
) -> list[Relation]:
    """Return the relation of each result to the query.

    Only results whose eigenvalues and area allow it are registered. The file of the query is read once.
    """
    parameters = query.active_pipeline.pipeline.parameters
    first = Surface(query.embedding, query.record, None if query.mesh is None else once(query.mesh))
    relations = []
    for result in results:
        copy = None
        facts = result.shape.facts
        if may_be_copy(result.spectral, first.radius, facts["scale"] / facts["area"] ** 0.5):
            second = _stored_surface(container, collection, result)
            if second is not None:
                copy = await _copy(container, first, second, result.spectral, parameters)
        probability = max(result.combined, result.typical_probability)
        relations.append(_relation(result.spectral, result.cc, probability, copy))
    return relations


async def relation_of(
    container: Container,
    comparison: Comparison,
    typical_probability: float,
    records: tuple[bytes, bytes],
    meshes: tuple[ReadMesh, ReadMesh],
) -> Relation:
    """Return the relation of the second of two compared shapes to the first.

    Parameters
    ----------
    container : Container
    comparison : Comparison
    typical_probability : float
        Their class probability at the typical density of shapes.
    records : two bytes
        The records of both embeddings.
    meshes : two callables
        They read the two meshes.
    """
    first = Surface(comparison.first, records[0], meshes[0])
    second = Surface(comparison.second, records[1], meshes[1])
    spectral = float(spectral_distances(first.embedding.signature, second.embedding.signature[None])[0])
    copy = None
    if may_be_copy(spectral, first.radius, second.radius):
        copy = await _copy(container, first, second, spectral, comparison.pipeline.parameters)
    probability = max(comparison.combined, typical_probability)
    return _relation(spectral, comparison.match.cc, probability, copy)


def _stored_surface(
    container: Container, collection: CollectionNumber, result: SearchResult
) -> Surface | None:
    """Return the surface of a result; None if it was deleted meanwhile, or its record cannot be read."""
    if result.record is None:
        log.warning("a result is not registered: its embedding is missing or damaged")
        return None
    try:
        embedding = embedding_from_bytes(result.record)
    except BadRecordError as error:
        log.warning("a result is not registered: %s", error)
        return None
    return Surface(embedding, result.record, partial(stored_mesh, container, collection, result.shape.id))


async def _copy(
    container: Container, first: Surface, second: Surface, spectral: float, parameters: Parameters
) -> RigidCopy | None:
    """Find a rigid copy or a variant: by the samples of the records, else by the surfaces of small meshes."""
    copy = copy_by_samples(first.embedding, second.embedding, spectral)
    if copy is not None or first.mesh is None or second.mesh is None:
        return copy
    if not (first.is_small and second.is_small):
        return None
    try:
        meshes = await asyncio.gather(first.mesh(), second.mesh())
        return await container.queue.do(
            tasks.registered, *meshes, first.record, second.record, parameters, True
        )
    except (CoreError, ServiceError) as error:
        log.warning("a result is not registered: %s", error)
        return None


def _relation(spectral: float, cc: float, probability: float, copy: RigidCopy | None) -> Relation:
    kind = likeness(
        spectral=spectral,
        cc=cc,
        probability=probability,
        scale=None if copy is None else copy.scale,
        mirrored=copy is not None and copy.mirrored,
        variant=copy is not None and copy.difference is not None,
    )
    return Relation(kind) if copy is None else Relation(kind, copy.scale, copy.difference)


def once(read: ReadMesh) -> ReadMesh:
    """Return a function that reads a mesh at its first call and keeps it."""
    meshes: list[Mesh] = []

    async def kept() -> Mesh:
        if not meshes:
            meshes.append(await read())
        return meshes[0]

    return kept
