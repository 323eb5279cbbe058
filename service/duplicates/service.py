"""The search for near-identical shapes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.errors import BadRecordError, MeshError
from core.mesh.mesh import Mesh
from core.registration.rigid_copy import COPY_RADIUS, RigidCopy
from service.collection import CollectionNumber
from service.container import Container
from service.duplicates.groups import GroupMember, Groups, Link
from service.duplicates.pairs import ExaminedShapes, near, stock
from service.errors import FileTimeLimitError, ShapeNotFoundError
from service.observability.logging import get_logger
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository, tasks
from service.search.records import Query
from service.search.scoring import compare_with
from service.search.shortlist import Candidates
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, ShapeRecord

log = get_logger("duplicates")


@dataclass(frozen=True)
class DuplicateCriteria:
    """The shapes to examine, the least CC of a pair, the largest residual, and whether variants count."""

    filter: ShapeFilter
    min_cc: float
    max_residual: float
    variants: bool

    @property
    def radii(self) -> float:
        """The largest difference of the radii of a pair; a local difference changes a radius."""
        return max(self.max_residual, COPY_RADIUS) if self.variants else self.max_residual


@dataclass(frozen=True)
class Duplicates:
    """Groups of near-identical shapes; the numbers of examined shapes, compared pairs and aligned pairs."""

    groups: list[list[tuple[GroupMember, ShapeRecord]]]
    shapes: int
    compared: int
    aligned: int


@dataclass(frozen=True)
class _Side:
    """A shape to align: its mesh and its embedding record."""

    mesh: Mesh
    record: bytes


async def find(
    container: Container, wanted: DuplicateCriteria, active_pipeline: ActivePipeline, timings: Timings
) -> Duplicates:
    """Find the groups of near-identical shapes.

    Stages: list the shapes; compare each with later shapes of near signature; align the meshes of pairs with
    the wanted CC, unless other links have joined them; read the records of the groups. Deleted shapes and
    unreadable files are left out.
    """

    def read() -> ExaminedShapes:
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
class _SimilarShapes:
    """A shape, its similar later shapes as (number, embedding, CC), and the number of compared shapes."""

    shape: int
    embedding: int
    others: Sequence[tuple[int, int, float]]
    compared: int


async def _alike(
    container: Container,
    stored: ExaminedShapes,
    place: int,
    wanted: DuplicateCriteria,
    active_pipeline: ActivePipeline,
) -> _SimilarShapes:
    """Compare a shape with later ones of near signature; those with the wanted CC are similar."""
    shape, embedding = int(stored.shapes[place]), int(stored.embeddings[place])
    places = await run_in_threadpool(near, stored, place, wanted.radii)
    record = (await _records(container, [embedding])).get(embedding) if len(places) else None
    if record is None:
        return _SimilarShapes(shape, embedding, [], 0)
    candidates = Candidates(
        shapes=stored.shapes[places],
        embeddings=stored.embeddings[places],
        signature=stored.signatures[place],
        signatures=stored.signatures[places],
        coarse_samples=np.empty((len(places), 0), np.uint8),
        view_signatures=np.empty((len(places), 0), np.uint8),
        reliabilities=np.full(len(places), np.nan, np.float32),
        reranked=None,
        finalists=None,
        stored=len(stored.shapes),
        sample=None,
    )
    found, _ = await compare_with(
        container, Query(active_pipeline, record, frozenset([shape])), candidates, "cc"
    )
    own = dict(zip(candidates.shapes.tolist(), candidates.embeddings.tolist(), strict=True))
    scores = zip(found.shapes.tolist(), found.cc.tolist(), strict=True)
    others = [(number, own[number], cc) for number, cc in scores if cc >= wanted.min_cc]
    return _SimilarShapes(shape, embedding, others, len(places))


async def _link(
    container: Container,
    groups: Groups,
    alike: _SimilarShapes,
    wanted: DuplicateCriteria,
    active_pipeline: ActivePipeline,
) -> int:
    """Align a shape with its similar ones and join near-identical pairs; the number of aligned pairs."""
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
            log.warning("two shapes cannot be aligned: %s", error)
            continue
        count += 1
        if found is None or found.residual > wanted.max_residual:
            continue
        variant = found.difference is not None
        if wanted.variants or not variant:
            groups.join(Link(alike.shape, number, cc, found.residual, found.scale, found.mirrored, variant))
    return count


async def _aligned(
    container: Container, first: _Side, second: _Side, active_pipeline: ActivePipeline
) -> RigidCopy | None:
    parameters = active_pipeline.pipeline.parameters
    return await container.work.do(
        tasks.registered, first.mesh, second.mesh, first.record, second.record, parameters
    )


async def _side(container: Container, collection: CollectionNumber, number: int, embedding: int) -> _Side:
    """The mesh of a shape, read from its file, and its embedding record.

    Raises
    ------
    ShapeNotFoundError
        The shape or its embedding was deleted.
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
    groups: list[list[GroupMember]],
    active_pipeline: ActivePipeline,
) -> list[list[tuple[GroupMember, ShapeRecord]]]:
    """The groups with the records of their shapes, without groups of which fewer than two shapes remain."""

    def read() -> list[list[tuple[GroupMember, ShapeRecord]]]:
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
