"""The likeness of stored shapes to a query: rigid copies are confirmed by registration."""

import asyncio
import math
from functools import partial
from typing import Any

from starlette.concurrency import run_in_threadpool

from core.errors import CoreError
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.ranking.likeness import likeness
from core.ranking.shortlist import spectral_distances
from core.registration.rigid_copy import RigidCopy, copy_by_samples, may_be_copy
from service.collection import CollectionNumber
from service.compute import tasks
from service.container import Container
from service.errors import ServiceError
from service.observability.logging import get_logger
from service.search.records import Surface, once
from service.search.schemas import LocalDifference
from service.shapes import file_repository
from service.shapes import service as shapes_service
from service.storage.database import ReadSession

log = get_logger("likeness")

MOST_FACES = 20_000
"""Most faces of a mesh that is registered; larger meshes are copies by the samples of their records alone."""


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

    Surfaces are registered only if the distance of their log eigenvalues (`spectral`) and their areas allow a
    copy. A surface is no copy if it is None, cannot be read, or is deleted meanwhile. `probability` is their
    class probability.
    """
    copy = None
    try:
        if second is not None and may_be_copy(spectral, first.radius, second.radius):
            copy = await find_copy(container, first, second, parameters, most_faces=MOST_FACES)
    except (CoreError, ServiceError) as error:
        log.warning("a result is not registered: %s", error)
    scale = None if copy is None else copy.scale
    kind = likeness(
        spectral=spectral,
        cc=cc,
        probability=probability,
        scale=scale,
        mirrored=copy is not None and copy.mirrored,
        variant=copy is not None and copy.difference is not None,
    )
    difference = copy and copy.difference and LocalDifference.model_validate(copy.difference)
    return {"likeness": kind, "scale": scale, "difference": difference}


async def find_copy(
    container: Container,
    first: Surface,
    second: Surface,
    parameters: Parameters,
    *,
    variants: bool = True,
    most_faces: float = math.inf,
) -> RigidCopy | None:
    """Return the second surface as a rigid copy of the first, or a variant if these are wanted, else None.

    Stages: compare the samples of the records; where they do not decide it, register both meshes, unless one
    has more than `most_faces` faces.

    Raises
    ------
    BadRecordError, FileTimeLimitError, MeshError, ShapeNotFoundError
        A record or a file cannot be used, or was deleted.
    """

    def by_samples() -> RigidCopy | None:
        embeddings = first.embedding, second.embedding
        spectral = spectral_distances(embeddings[0].signature, embeddings[1].signature[None])
        return copy_by_samples(*embeddings, float(spectral[0]))

    copy = await run_in_threadpool(by_samples)
    faces = max(first.embedding.facts.faces, second.embedding.facts.faces)
    if copy is not None or first.mesh is None or second.mesh is None or faces > most_faces:
        return copy
    meshes = await asyncio.gather(first.mesh(), second.mesh())
    return await container.queue.do(
        tasks.registered, *meshes, first.record, second.record, parameters, variants
    )
