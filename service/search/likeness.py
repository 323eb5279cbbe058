"""The likeness of stored shapes to a query: rigid copies are confirmed by registration."""

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from functools import partial
from typing import Any, Literal, TypeVar

from starlette.concurrency import run_in_threadpool

from core.descriptors.pieces import number_of_pieces
from core.errors import CoreError
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.ranking.isometry import isometry_distance
from core.ranking.likeness import least_bend, likeness, may_be_pose
from core.ranking.shortlist import spectral_distances
from core.registration.instances import Instances, possible_instances
from core.registration.rigid_copy import RigidCopy, copy_by_samples, have_equal_axes, may_be_copy
from core.registration.similarity import bend
from service.collection import CollectionNumber
from service.compute import tasks
from service.container import Container
from service.errors import ServiceError
from service.observability.logging import get_logger
from service.search.local_difference import LocalDifference
from service.search.part_instances import PartInstances
from service.search.records import Surface, once
from service.shapes import file_repository
from service.shapes import service as shapes_service
from service.storage.database import ReadSession

log = get_logger("likeness")

Told = TypeVar("Told")


async def stored_mesh(container: Container, collection: CollectionNumber, shape_id: str) -> Mesh:
    """Read the mesh of a shape from its file.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """

    def read(session: ReadSession) -> tuple[bytes, str]:
        shape = shapes_service.get(session, collection, shape_id)
        return file_repository.file_of(session, collection, shape_id), shape.format

    return await container.queue.read(*await container.database.reading(read))


def stored_surface(
    container: Container, collection: CollectionNumber, shape_id: str, record: bytes
) -> Surface:
    """Return the surface of a stored shape with this embedding record; its file is read once."""
    return Surface(record, once(partial(stored_mesh, container, collection, shape_id)))


async def relation_of(
    container: Container,
    first: Surface,
    second: Surface | None,
    parameters: Parameters,
    *,
    spectral: float,
    cc: float,
    probability: float,
) -> dict[str, Any]:
    """Return the fields of `PairScores` that tell the relation of a second surface to a first one.

    Surfaces are registered only if the distance of their log eigenvalues (`spectral`) or their proportions
    allow a copy. A surface is neither copy nor pose if it is None, and no copy if it cannot be read or is
    deleted meanwhile. `probability` is their class probability.
    """
    copy, found, posed = None, None, False

    def possible() -> bool:
        return second is not None and may_be_copy(spectral, first.proportions, second.proportions)

    try:
        # The records are decoded on a thread.
        if second is not None and await run_in_threadpool(possible):
            copy = await find_copy(container, first, second, parameters)
        # A pair whose registration failed may be a copy, and no pose.
        if copy is None and second is not None and may_be_pose(spectral, cc):
            posed = await run_in_threadpool(is_pose, first, second, parameters, cc)
    except (CoreError, ServiceError) as error:
        log.warning("a result is not registered: %s", error)
    try:
        if copy is None and second is not None:
            found = await find_instances(container, first, second)
    except (CoreError, ServiceError) as error:
        log.warning("the pieces of a result are not registered: %s", error)
    scale = None if copy is None else copy.scale
    kind = likeness(
        probability=probability,
        scale=scale,
        mirrored=copy is not None and copy.mirrored,
        variant=copy is not None and copy.difference is not None,
        part=found is not None,
        pose=posed,
    )
    difference = None
    if copy is not None and copy.difference is not None:
        difference = LocalDifference.model_validate(copy.difference).model_copy(update={"scale": copy.scale})
    transform = copy and copy.placing.matrix.tolist()
    return {
        "likeness": kind,
        "scale": scale,
        "transform": transform,
        "difference": difference,
        "instances": found,
    }


def is_pose(first: Surface, second: Surface, parameters: Parameters, cc: float) -> bool:
    """Return whether two surfaces are nearly isometric, and their correspondence is far from rigid."""
    embeddings = first.embedding, second.embedding
    isometry = isometry_distance(*embeddings)
    if not may_be_pose(isometry, cc):
        return False
    ends = Pipeline(parameters).match(*embeddings).points(*embeddings)
    return bool(bend(*ends) >= least_bend(isometry) * embeddings[1].facts.area ** 0.5)


async def find_instances(container: Container, first: Surface, second: Surface) -> PartInstances | None:
    """Return how many pieces of one surface are copies of the other, which has one piece; None for none.

    Raises
    ------
    BadRecordError, FileTimeLimitError, MeshError, ShapeNotFoundError
        A record or a file cannot be used, or was deleted.
    """

    def ways() -> tuple[int, bool]:
        pieces = first.embedding.pieces, second.embedding.pieces
        return possible_instances(*pieces), number_of_pieces(pieces[0]) == 1

    possible, first_is_part = await run_in_threadpool(ways)
    if not possible or first.mesh is None or second.mesh is None:
        return None

    async def counted() -> Instances:
        meshes = await _meshes(first, second)
        part, whole = meshes if first_is_part else meshes[::-1]
        return await container.queue.do(tasks.instances_in, part, whole)

    found = await _known(container, ("instances", first.digest, second.digest), counted)
    if not found.count and not found.mirrored:
        return None
    whole: Literal["first", "second"] = "second" if first_is_part else "first"
    return PartInstances(whole=whole, count=found.count, mirrored=found.mirrored)


async def _known(container: Container, pair: Hashable, tell: Callable[[], Awaitable[Told]]) -> Told:
    """Return what registration tells of a pair; it is kept, so that a pair is not registered twice."""
    relations = container.relations
    if pair in relations:
        known: Told = relations[pair]
        return known
    told = relations[pair] = await tell()
    return told


async def _meshes(first: Surface, second: Surface) -> tuple[Mesh, Mesh]:
    assert first.mesh is not None
    assert second.mesh is not None
    return await asyncio.gather(first.mesh(), second.mesh())


async def find_copy(
    container: Container, first: Surface, second: Surface, parameters: Parameters, *, variants: bool = True
) -> RigidCopy | None:
    """Return the second surface as a rigid copy of the first, or a variant if these are wanted, else None.

    Stages: compare the samples and the principal radii of the records; where these do not decide it, register
    both meshes.

    Raises
    ------
    BadRecordError, FileTimeLimitError, MeshError, ShapeNotFoundError
        A record or a file cannot be used, or was deleted.
    """

    def by_samples() -> tuple[RigidCopy | None, bool]:
        embeddings = first.embedding, second.embedding
        spectral = spectral_distances(embeddings[0].signature, embeddings[1].signature[None])
        return copy_by_samples(*embeddings, float(spectral[0])), have_equal_axes(*embeddings)

    copy, may_be = await run_in_threadpool(by_samples)
    if copy is not None or not may_be or first.mesh is None or second.mesh is None:
        return copy

    async def registered() -> RigidCopy | None:
        meshes = await _meshes(first, second)
        records = first.record, second.record
        return await container.queue.do(tasks.registered, *meshes, *records, parameters, variants)

    return await _known(container, (first.digest, second.digest, variants), registered)
