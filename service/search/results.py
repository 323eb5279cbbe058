"""The results of a query: read, told by their likeness to it, and sorted."""

import asyncio
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from starlette.concurrency import run_in_threadpool

from core.ranking.likeness import SAME_SIZE, may_be_pose
from core.ranking.shortlist import spectral_distances
from core.registration.rigid_copy import may_be_copy
from service.collection import CollectionNumber
from service.compute.request_queue import short_of_memory, together
from service.compute.tasks import match_embeddings
from service.container import Container
from service.search.likeness import relation_of, stored_surface
from service.search.plates import possible_wholes_and_parts
from service.search.records import MatchedCandidates, Query, Surface, may_be_part, proportions_of
from service.search.schemas import Pair, RankBy, Result, SearchOptions, pairs
from service.search.scoring import Cascade, class_log_odds
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.shapes.schemas import Shape

CERTAIN = 0.99
"""Value of `combined` above which it orders no results."""

AT_ONCE = 3
"""Results of a query whose likeness is told at the same time."""


def ranked(matched: MatchedCandidates, by: RankBy) -> NDArray[np.intp]:
    """Return indices of matched candidates, the most similar first; ties by ascending SSD, then by number.

    Near copies, such as two scans of one part, can have the CC and sim of the shape itself, but another SSD.
    """
    score = {
        "cc": matched.cc,
        "ssd": -matched.ssd,
        "sim": matched.sim,
        "combined": matched.log_odds,
        "contextual": matched.contextual,
    }[by]
    assert score is not None
    return np.lexsort((matched.candidates.entries.shapes, matched.ssd, -score))


@dataclass(frozen=True, eq=False)
class BestResult:
    """A result before its likeness is told, and what tells it.

    `surface` is None unless its record was read: for correspondences, or since the shape may be a rigid copy
    (`may_be_copy`) or a pose, or one of the two a part of the other. `spectral` is the distance of the log
    eigenvalues of the shape from those of the query, and `number` that of the shape.
    """

    number: int
    result: Result
    surface: Surface | None
    spectral: float
    may_be_copy: bool

    @property
    def is_certain(self) -> bool:
        """Whether `combined` is so near to 1 that it orders nothing."""
        return self.result.combined > CERTAIN


def misfit(best: BestResult) -> tuple[float, ...]:
    """Return what orders results: certain copies come first, then certain variants, then others.

    Copies are sorted by size, the nearest first, with mirror images last; variants by whether they have as
    many holes, by size, and by the distance of the difference. Results that compare equal keep their order.
    """
    result = best.result
    if not best.is_certain or result.scale is None:
        return (2.0,)
    growth = abs(math.log(result.scale))
    if (difference := result.difference) is None:
        # A scale is right to about 1e-4.
        return (0.0, round(growth, 3), float(result.likeness == "mirrored"))
    holes = difference.through_holes
    resized = max(0.0, growth - math.log1p(SAME_SIZE))
    return (1.0, float(holes is not None and holes[0] != holes[1]), resized, difference.distance)


def read_results(
    cascade: Cascade,
    best: MatchedCandidates,
    collection: CollectionNumber,
    part_distances: Mapping[int, float],
    *,
    every_record: bool,
) -> list[BestResult]:
    """Return the best candidates as they are shown, without one that was deleted a moment ago.

    The embedding is read of a result that may be a copy, a pose, a whole or a part, and of all with
    `every_record`.
    """
    container, query, reader = cascade.container, cascade.query, cascade.reader
    entries = best.candidates.entries
    numbers = entries.embeddings.tolist()
    spectral = spectral_distances(query.embedding.signature, entries.signatures).tolist()
    described = reader.descriptors(numbers)
    log_odds = best.log_odds
    if log_odds is None:
        log_odds = class_log_odds(query, best.candidates, numbers, described, best.cc, best.sim)
    with container.database.read() as session:
        records = shapes_repository.records(session, collection, entries.shapes.tolist())
    shapes = {shape.number: shape for shape in records}
    present = [(i, shapes[number]) for i, number in enumerate(entries.shapes.tolist()) if number in shapes]
    copies = {
        i for i, shape in present if may_be_copy(spectral[i], query.proportions, proportions_of(shape.facts))
    }
    embeddings = reader.records(
        [
            numbers[i]
            for i, shape in present
            if every_record
            or i in copies
            or may_be_pose(spectral[i], float(best.cc[i]))
            or may_be_part(query.embedding.facts, shape.facts)
        ]
    )
    return [
        BestResult(
            shape.number,
            Result(
                rank=rank,
                cc=float(best.cc[i]),
                ssd=float(best.ssd[i]),
                sim=float(best.sim[i]),
                combined=float(expit(log_odds[i])),
                likeness="weak",
                part_distance=part_distances.get(shape.number),
                size_ratio=float((shape.facts["area"] / query.embedding.facts.area) ** 0.5),
                shape=Shape.of(shape),
            ),
            stored_surface(container, collection, shape.id, embeddings[numbers[i]])
            if numbers[i] in embeddings
            else None,
            spectral[i],
            i in copies,
        )
        for rank, (i, shape) in enumerate(present, start=1)
    ]


async def correspondence_with(
    container: Container, query: Query, surface: Surface | None
) -> list[Pair] | None:
    """Match the query with a result; None if the embedding of the result was deleted meanwhile."""
    if surface is None:
        return None
    parameters = query.active_pipeline.pipeline.parameters
    match = await container.queue.compare(match_embeddings, query.record, surface.record, parameters)
    return pairs(match, query.embedding, surface.embedding)


async def _likened(container: Container, query: Query, best: BestResult) -> BestResult:
    """Return a result with its likeness to the query, and its size relative to that of the query."""
    relation = await relation_of(
        container,
        query,
        best.surface,
        query.active_pipeline.pipeline.parameters,
        spectral=best.spectral,
        cc=best.result.cc,
        probability=best.result.combined,
    )
    size_ratio = relation["scale"] or best.result.size_ratio
    return replace(best, result=best.result.model_copy(update={**relation, "size_ratio": size_ratio}))


async def all_likened(container: Container, query: Query, best: list[BestResult]) -> list[BestResult]:
    """Return results with their likeness to the query, `AT_ONCE` at a time, in their order."""
    turns = asyncio.Semaphore(AT_ONCE)

    async def in_turn(each: BestResult) -> BestResult:
        async with turns:
            return await _likened(container, query, each)

    return await together(in_turn(each) for each in best)


async def parts_of(cascade: Cascade, shapes: ShapeFilter, options: SearchOptions) -> list[BestResult]:
    """Return shapes that have the query as a piece, or are pieces of it: more instances first, then older."""
    container, query = cascade.container, cascade.query
    candidates = await run_in_threadpool(possible_wholes_and_parts, container, query, shapes, options.top_k)
    if candidates is None:
        return []
    matched = await cascade.score(candidates, options.top_k)
    with short_of_memory():
        read = await run_in_threadpool(
            read_results, cascade, matched, shapes.collection, {}, every_record=True
        )
    found = [each for each in await all_likened(container, query, read) if each.result.instances is not None]
    return sorted(found, key=lambda each: (-_instances(each.result), each.number))


def _instances(result: Result) -> int:
    """Return the number of instances of either hand."""
    return 0 if result.instances is None else result.instances.count + result.instances.mirrored
