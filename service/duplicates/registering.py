"""The registration of two stored shapes, by their records or by their files."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from starlette.concurrency import run_in_threadpool

from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.ranking.spectral_distance import spectral_distances
from core.registration.rigid_copy import RigidCopy, copy_by_samples
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.container import Container
from service.errors import ShapeNotFoundError
from service.search import repository, tasks
from service.shapes import repository as shapes_repository


@dataclass(frozen=True, eq=False)
class Side:
    """A shape to register: its embedding record, and a function that reads its mesh."""

    record: bytes
    mesh: Callable[[], Awaitable[Mesh]]


async def side_of(container: Container, collection: CollectionNumber, number: int, embedding: int) -> Side:
    """A stored shape.

    Raises
    ------
    ShapeNotFoundError
        The shape or its embedding was deleted.
    """

    def read_record() -> bytes:
        with container.database.read() as session:
            records = repository.embedding_records(session, [embedding])
        if embedding not in records:
            raise ShapeNotFoundError(str(number))
        return records[embedding]

    def read_file() -> tuple[bytes, str]:
        with container.database.read() as session:
            shapes = shapes_repository.records(session, "", collection, [number])
            data = shapes_repository.file_of(session, collection, shapes[0].id) if shapes else None
        if data is None:
            raise ShapeNotFoundError(str(number))
        return data, shapes[0].format

    async def mesh() -> Mesh:
        return await container.queue.read(*await run_in_threadpool(read_file))

    return Side(await run_in_threadpool(read_record), mesh)


async def registered(
    container: Container, first: Side, second: Side, parameters: Parameters, *, variants: bool
) -> RigidCopy | None:
    """The second shape as a copy of the first, or as a variant if these are wanted; None if it is neither.

    Raises
    ------
    BadRecordError, FileTimeLimitError, MeshError, ShapeNotFoundError
        A record or a file cannot be used, or was deleted.
    """
    copy = await run_in_threadpool(_by_samples, first.record, second.record, parameters)
    if copy is not None:
        return copy
    meshes = await first.mesh(), await second.mesh()
    return await container.queue.do(
        tasks.registered, *meshes, first.record, second.record, parameters, variants
    )


def _by_samples(first: bytes, second: bytes, parameters: Parameters) -> RigidCopy | None:
    one, other = embedding_from_bytes(first), embedding_from_bytes(second)
    spectral = spectral_distances(
        one.signature, other.signature[None], global_descriptors=parameters.ranking.global_descriptors
    )
    return copy_by_samples(one, other, float(spectral[0]))
