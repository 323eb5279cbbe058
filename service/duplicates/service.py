"""Finding the stored shapes that are near-identical."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.errors import BadRecordError, MeshError
from core.mesh.mesh import Mesh
from core.registration.similarity_icp import Alignment
from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import tasks
from service.duplicates.groups import Groups, Link, Member
from service.duplicates.pairs import Stock, near, stock
from service.errors import FileTimeLimitError, ShapeNotFoundError
from service.observability.logging import get_logger
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.records import Query
from service.search.scoring import compare_with
from service.search.shortlist import Candidates
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, ShapeRecord

log = get_logger("duplicates")


@dataclass(frozen=True)
class Wanted:
    """Among which shapes to look, and how alike near-identical ones are at least."""

    filter: ShapeFilter
    min_cc: float
    max_residual: float


@dataclass(frozen=True)
class Duplicates:
    """The groups; how many shapes were looked at, and how many pairs were compared and laid together."""

    groups: list[list[tuple[Member, ShapeRecord]]]
    shapes: int
    compared: int
    aligned: int


@dataclass(frozen=True)
class _Side:
    """A shape as it is laid onto another."""

    mesh: Mesh
    record: bytes


async def find(
    container: Container, wanted: Wanted, active_pipeline: ActivePipeline, timings: Timings
) -> Duplicates:
    """The groups of near-identical shapes.

    Each shape is compared with those behind it that are near by signature; the meshes of those that are
    alike by CC are laid onto each other, unless other links have brought them into one group already. A
    shape that was deleted meanwhile, or whose file cannot be read any more, is left out.
    """

    def read() -> Stock:
        with container.database.read() as session:
            return stock(session, active_pipeline, wanted.filter)

    with timings.stage("shortlist"):
        stored = await run_in_threadpool(read)
    with timings.stage("compare"):
        alike = [
            await _alike(container, stored, place, wanted, active_pipeline)
            for place in range(len(stored.shapes))
        ]
    groups = Groups()
    with timings.stage("align"):
        aligned = sum([await _link(container, groups, each, wanted, active_pipeline) for each in alike])
    with timings.stage("results"):
        shown = await _shown(container, wanted.filter.collection, groups.members(), active_pipeline)
    return Duplicates(shown, len(stored.shapes), sum(each.compared for each in alike), aligned)


@dataclass(frozen=True)
class _Alike:
    """A shape, the others that are like it, each with its embedding and CC, and how many were compared."""

    shape: int
    embedding: int
    others: Sequence[tuple[int, int, float]]
    compared: int


async def _alike(
    container: Container, stored: Stock, place: int, wanted: Wanted, active_pipeline: ActivePipeline
) -> _Alike:
    """The shapes behind one that have the CC wanted: numbers, those of their embeddings, and CC."""
    shape, embedding = int(stored.shapes[place]), int(stored.embeddings[place])
    places = await run_in_threadpool(near, stored, place, wanted.max_residual)
    record = (await _records(container, [embedding])).get(embedding) if len(places) else None
    if record is None:
        return _Alike(shape, embedding, [], 0)
    candidates = Candidates(
        shapes=stored.shapes[places],
        embeddings=stored.embeddings[places],
        signature=stored.signatures[place],
        signatures=stored.signatures[places],
        coarse_samples=np.empty((len(places), 0), np.uint8),
        reranked=None,
        finalists=None,
        stored=len(stored.shapes),
    )
    found, _ = await compare_with(
        container, Query(active_pipeline, record, frozenset([shape])), candidates, "cc"
    )
    own = dict(zip(candidates.shapes.tolist(), candidates.embeddings.tolist(), strict=True))
    scores = zip(found.shapes.tolist(), found.cc.tolist(), strict=True)
    others = [(number, own[number], cc) for number, cc in scores if cc >= wanted.min_cc]
    return _Alike(shape, embedding, others, len(places))


async def _link(
    container: Container, groups: Groups, alike: _Alike, wanted: Wanted, active_pipeline: ActivePipeline
) -> int:
    """Join a shape with those that it is near-identical to; how many were laid onto it."""
    count = 0
    collection = wanted.filter.collection
    first: _Side | None = None
    for number, embedding, cc in alike.others:
        if groups.joined(alike.shape, number):
            continue
        try:
            first = first or await _side(container, collection, alike.shape, alike.embedding)
            second = await _side(container, collection, number, embedding)
            found = await _aligned(container, first, second, active_pipeline)
        except (BadRecordError, FileTimeLimitError, MeshError, ShapeNotFoundError) as error:
            log.warning("two shapes cannot be laid onto each other: %s", error)
            continue
        count += 1
        if found.residual <= wanted.max_residual:
            groups.join(Link(alike.shape, number, cc, found.residual, found.scale, found.mirrored))
    return count


async def _aligned(
    container: Container, first: _Side, second: _Side, active_pipeline: ActivePipeline
) -> Alignment:
    parameters = active_pipeline.pipeline.parameters
    return await container.work.do(
        tasks.aligned, first.mesh, second.mesh, first.record, second.record, parameters
    )


async def _side(container: Container, collection: CollectionNumber, number: int, embedding: int) -> _Side:
    """The mesh of a collection's shape, read anew, and its record.

    Raises
    ------
    ShapeNotFoundError
        It is gone, or its embedding is.
    """

    def read() -> tuple[bytes, str, bytes]:
        with container.database.read() as session:
            shapes = shapes_repository.records(session, "", collection, [number])
            records = repository.embedding_records(session, [embedding])
            data = shapes_repository.file_of(session, collection, shapes[0].id) if shapes else None
        if data is None or embedding not in records:
            raise ShapeNotFoundError(str(number))
        return data, shapes[0].format, records[embedding]

    data, format, record = await run_in_threadpool(read)
    return _Side(await container.work.read(data, format), record)


async def _records(container: Container, embeddings: list[int]) -> dict[int, bytes]:
    def read() -> dict[int, bytes]:
        with container.database.read() as session:
            return repository.embedding_records(session, embeddings)

    return await run_in_threadpool(read)


async def _shown(
    container: Container,
    collection: CollectionNumber,
    groups: list[list[Member]],
    active_pipeline: ActivePipeline,
) -> list[list[tuple[Member, ShapeRecord]]]:
    """The groups with their shapes' records, without those of which fewer than two are left."""

    def read() -> list[list[tuple[Member, ShapeRecord]]]:
        shown = []
        with container.database.read() as session:
            for group in groups:
                numbers = [member.shape for member in group]
                records = shapes_repository.records(session, active_pipeline.fingerprint, collection, numbers)
                known = {record.number: record for record in records}
                left = [(member, known[member.shape]) for member in group if member.shape in known]
                shown.append(left)
        return [group for group in shown if len(group) > 1]

    return await run_in_threadpool(read)
