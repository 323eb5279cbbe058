"""The search for the most similar stored shapes: a query in, its answer out."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from starlette.concurrency import run_in_threadpool

from core.io import format_of
from core.ranking.likeness import SAME_SIZE, Likeness, may_be_pose
from core.ranking.shortlist import least, spectral_distances
from core.registration.rigid_copy import may_be_copy
from service.collection import CollectionNumber
from service.compute.request_queue import short_of_memory, together
from service.compute.tasks import match_embeddings
from service.container import Container
from service.errors import NotEmbeddedError
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.caches import BatchReader, CandidateReader
from service.search.likeness import relation_of, stored_mesh, stored_surface
from service.search.neighbours import in_context
from service.search.plates import possible_wholes_and_parts
from service.search.records import MatchedCandidates, Query, Surface, may_be_part, once, proportions_of
from service.search.schemas import (
    Pair,
    QueryAnswer,
    RankBy,
    Result,
    SearchOptions,
    likeness_in_words,
    pairs,
    score_in_words,
)
from service.search.scoring import Cascade, class_log_odds, coarse_log_odds, find_candidates, nearest_wholes
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, sha256
from service.shapes.schemas import EmbeddingArrays, MeasuredMesh, Shape, warnings_of
from service.storage.database import ReadSession

UNITS = (10.0, 25.4, 1000.0)
"""Millimetres in a centimetre, in an inch and in a metre."""

FACTORS = (*UNITS, *(1.0 / factor for factor in UNITS))
"""Factors between the sizes of files whose units are mistaken."""

CERTAIN, REGISTERED = 0.99, 8
"""Value of `combined` above which it orders no results, and the number of further results that are registered
with the query, if they may be copies, to find the best of these."""

AT_ONCE = 3
"""Results of a query whose likeness is told at the same time."""

PARTIAL_FACTOR = 2.5
"""Factor of the number of candidates from which a partial query compares a shortlist: this may miss the whole
of a part, whose signature is another."""

NO_CONTEXT = "the order is that of combined: the neighbours of most candidates are not known yet"

Done = TypeVar("Done")

SearchedFile = tuple[str, Callable[[], Awaitable[bytes]]]
"""The name of a file, and the function that reads it."""


async def with_active_pipeline(
    container: Container, work: Callable[[ActivePipeline], Awaitable[Done]]
) -> Done:
    """Return the result of work with the active pipeline; repeat it if the archive changed its pipeline.

    The embeddings that the work began with may have been deleted.
    """
    reading, current = container.database.reading, container.pipelines.current
    active_pipeline = await reading(current)
    while True:
        try:
            done = await work(active_pipeline)
        except NotEmbeddedError:
            before, active_pipeline = active_pipeline, await reading(current)
            if active_pipeline is before:
                raise
        else:
            before, active_pipeline = active_pipeline, await reading(current)
            if active_pipeline is before:
                return done


async def query_of_file(
    container: Container,
    collection: CollectionNumber,
    file: SearchedFile,
    exclude_self: bool,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Query:
    """Read and embed a file; with `exclude_self`, shapes of the collection with the same bytes are left out.

    Raises
    ------
    MeshError
        The file cannot be used; the subclass says why.
    """
    name, read = file
    format = format_of(name)
    data = await read()
    embedded = await container.queue.embed(data, format, active_pipeline.pipeline)
    timings.milliseconds |= embedded.milliseconds

    same_bytes: list[int] = []
    if exclude_self:
        same_bytes = await container.database.reading(repository.numbers_of_bytes, collection, sha256(data))
    return Query(
        embedded.record,
        once(partial(container.queue.read, data, format)),
        measured=MeasuredMesh.in_format(embedded.facts, format),
        active_pipeline=active_pipeline,
        excluded=frozenset(same_bytes),
        warnings=tuple(embedded.facts["warnings"]),
    )


def query_of_shape(
    session: ReadSession,
    container: Container,
    collection: CollectionNumber,
    shape_id: str,
    exclude_self: bool,
    active_pipeline: ActivePipeline,
) -> Query:
    """Read the embedding of a stored shape; with `exclude_self`, the shape itself is left out.

    Raises
    ------
    ShapeNotFoundError, NotEmbeddedError
        The collection has no such shape, or no embedding of it.
    """
    stored = file_repository.embedding_of(session, active_pipeline.fingerprint, collection, shape_id)
    return Query(
        stored.record,
        once(partial(stored_mesh, container, collection, shape_id)),
        measured=MeasuredMesh.in_format(stored.facts, stored.format),
        active_pipeline=active_pipeline,
        excluded=frozenset([stored.shape] if exclude_self else []),
        number=stored.number,
    )


async def search(
    container: Container,
    query: Query,
    options: SearchOptions,
    shapes: ShapeFilter,
    timings: Timings,
    *,
    advise: bool = True,
    batch: BatchReader | None = None,
) -> QueryAnswer:
    """Find the stored shapes most like the query, or those that it is a part of.

    Stages: find the candidates of the query, or a shortlist of them; score the candidates; read the results;
    tell the likeness of each. With `advise`, tell of another order whose first result has a better
    likeness; and if the filter by size left nothing, of shapes larger or smaller by one of `FACTORS` (a unit
    mistake). Queries of one `batch` share its reader.

    Raises
    ------
    WorkerLostError
        There is too little memory, or a worker died.
    """
    active_pipeline = query.active_pipeline
    options = options.model_copy(update={"rank_by": options.rank_by or container.settings.rank_by})
    rank_by: RankBy = "cc" if options.partial or options.rank_by is None else options.rank_by
    reader = batch or CandidateReader(container, active_pipeline)
    by_log_odds = rank_by in {"combined", "contextual"}
    cascade = Cascade(container, query, reader, by_log_odds=by_log_odds)
    sized = _sized(shapes, options, query.embedding.facts.area)
    with timings.stage("shortlist"):
        shortlist_from = _shortlist_from(container, options)
        candidates = await run_in_threadpool(
            find_candidates, container, query, sized, shortlist_from, by_log_odds=by_log_odds
        )
    container.metrics.query_compared.observe(len(candidates))
    container.metrics.queries_shortlisted.inc(candidates.shortlisted)
    part_distances: dict[int, float] | None = None
    if options.partial:
        candidates, part_distances = await nearest_wholes(cascade, candidates, options.top_k, timings)
    with timings.stage("compare"):
        matched = await cascade.score(candidates, options.top_k)
    warnings = [*query.warnings, *warnings_of(query.embedding.facts.boundary_ratio)]
    if rank_by == "contextual":
        with timings.stage("context"):
            matched = await container.database.reading(in_context, query, matched)
        if matched.contextual is None:
            rank_by = "combined"
            warnings.append(NO_CONTEXT)
    with timings.stage("results"):
        best = ranked(matched, rank_by) if part_distances is None else np.arange(len(matched.cc))
        if options.min_cc is not None:
            best = best[matched.cc[best] >= options.min_cc]
        with short_of_memory():
            best_results = await run_in_threadpool(
                _read_results,
                cascade,
                matched.only(best[: options.top_k + by_log_odds * REGISTERED]),
                shapes.collection,
                part_distances or {},
                every_record=options.correspondences,
            )
    with timings.stage("likeness"):
        shown = await _all_likened(
            container,
            query,
            [
                each
                for number, each in enumerate(best_results)
                if number < options.top_k or (each.is_certain and each.may_be_copy)
            ],
        )
        if by_log_odds:
            shown.sort(key=_misfit)
        results = [
            each.result.model_copy(update={"rank": rank})
            for rank, each in enumerate(shown[: options.top_k], start=1)
        ]
        if advise and results and not options.partial:
            told = {each.number: result for each, result in zip(shown, results, strict=False)}
            warnings += await _order_warnings(cascade, matched.only(best), rank_by, told, shapes.collection)
    pieces: list[_BestResult] = []
    if advise and not options.partial:
        with timings.stage("instances"):
            others = replace(
                query, excluded=query.excluded | {each.number for each in shown[: options.top_k]}
            )
            pieces = await _parts(replace(cascade, query=others), shapes, options)
    parts = [
        each.result.model_copy(update={"rank": rank})
        for rank, each in enumerate(pieces, start=1 + len(results))
    ]
    if options.correspondences:
        with timings.stage("results"):
            for result, each in zip([*results, *parts], [*shown[: options.top_k], *pieces], strict=True):
                result.correspondence = await _correspondence(container, query, each.surface)
    compared = len(matched.cc) if part_distances is None else len(part_distances)
    if advise and sized.has_sizes and not compared:
        with timings.stage("units"):
            warnings += await _unit_warnings(container, query, options, sized)
    assert query.measured is not None
    return QueryAnswer(
        query=query.measured,
        results=results,
        parts=parts,
        matched=any(result.likeness != "weak" for result in [*results, *parts]),
        compared=compared,
        ranked_by="part_distance" if options.partial else rank_by,
        stored=candidates.stored,
        pipeline=active_pipeline.fingerprint,
        milliseconds=timings.so_far(),
        warnings=warnings,
        embedding=EmbeddingArrays.of(query.embedding) if options.embedding else None,
    )


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


def _shortlist_from(container: Container, options: SearchOptions) -> int | None:
    """Return the number of shapes from which a query compares a shortlist; None if it compares all."""
    if options.exhaustive:
        return None
    return math.ceil((PARTIAL_FACTOR if options.partial else 1.0) * container.settings.shortlist_from)


def _sized(shapes: ShapeFilter, options: SearchOptions, area: float) -> ShapeFilter:
    """Return the filter with the sizes that a query of some area asks for."""
    if options.scale == "ignore":
        return shapes
    factor = 1.0 + options.size_tolerance
    least, greatest = area / factor**2, area * factor**2
    if shapes.area is not None:
        least, greatest = max(least, shapes.area[0]), min(greatest, shapes.area[1])
    return replace(shapes, area=(least, greatest))


@dataclass(frozen=True, eq=False)
class _BestResult:
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


def _misfit(best: _BestResult) -> tuple[float, ...]:
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


def _read_results(
    cascade: Cascade,
    best: MatchedCandidates,
    collection: CollectionNumber,
    part_distances: Mapping[int, float],
    *,
    every_record: bool,
) -> list[_BestResult]:
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
        _BestResult(
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


async def _correspondence(container: Container, query: Query, surface: Surface | None) -> list[Pair] | None:
    """Match the query with a result; None if the embedding of the result was deleted meanwhile."""
    if surface is None:
        return None
    parameters = query.active_pipeline.pipeline.parameters
    match = await container.queue.compare(match_embeddings, query.record, surface.record, parameters)
    return pairs(match, query.embedding, surface.embedding)


async def _likened(container: Container, query: Query, best: _BestResult) -> _BestResult:
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


async def _all_likened(container: Container, query: Query, best: list[_BestResult]) -> list[_BestResult]:
    """Return results with their likeness to the query, `AT_ONCE` at a time, in their order."""
    turns = asyncio.Semaphore(AT_ONCE)

    async def in_turn(each: _BestResult) -> _BestResult:
        async with turns:
            return await _likened(container, query, each)

    return await together(in_turn(each) for each in best)


async def _parts(cascade: Cascade, shapes: ShapeFilter, options: SearchOptions) -> list[_BestResult]:
    """Return shapes that have the query as a piece, or are pieces of it: more instances first, then older."""
    container, query = cascade.container, cascade.query
    candidates = await run_in_threadpool(possible_wholes_and_parts, container, query, shapes, options.top_k)
    if candidates is None:
        return []
    matched = await cascade.score(candidates, options.top_k)
    with short_of_memory():
        read = await run_in_threadpool(
            _read_results, cascade, matched, shapes.collection, {}, every_record=True
        )
    found = [each for each in await _all_likened(container, query, read) if each.result.instances is not None]
    return sorted(found, key=lambda each: (-_instances(each.result), each.number))


def _instances(result: Result) -> int:
    """Return the number of instances of either hand."""
    return 0 if result.instances is None else result.instances.count + result.instances.mirrored


ORDERS: tuple[RankBy, ...] = ("combined", "cc", "sim", "ssd")
"""All orders by one score; of two with equally good first results, a warning names the former."""

DESCRIBED = 5
"""Candidates of greatest approximate log odds of which the greatest log odds are sought."""


async def _order_warnings(
    cascade: Cascade,
    matched: MatchedCandidates,
    rank_by: RankBy,
    results: Mapping[int, Result],
    collection: CollectionNumber,
) -> list[str]:
    """Return a warning of the order whose first result has the best likeness, if it is better than here.

    `matched` is sorted by `rank_by`, and `results` has its first ones by the numbers of their shapes.
    """
    grades = get_args(Likeness)
    first = next(iter(results.values()))
    if first.likeness == grades[0]:
        return []
    firsts = await run_in_threadpool(_firsts, cascade, matched, rank_by)
    numbers = matched.candidates.entries.shapes.tolist()
    unread = sorted({index for index in firsts.values() if numbers[index] not in results})
    chosen = matched.only(np.array(unread, dtype=np.intp))
    with short_of_memory():
        others = await run_in_threadpool(_read_results, cascade, chosen, collection, {}, every_record=False)
    likened = await _all_likened(cascade.container, cascade.query, others)
    told = {**results, **{other.number: other.result for other in likened}}
    graded = [
        (grades.index(told[numbers[index]].likeness), order, told[numbers[index]])
        for order, index in firsts.items()
        if numbers[index] in told
    ]
    grade, order, result = min(graded, key=itemgetter(0), default=(len(grades), rank_by, first))
    if grade >= grades.index(first.likeness):
        return []
    return [
        f"rank_by={order} has a better first result: {result.shape.name!r} "
        f"({likeness_in_words(result.likeness, result.scale)}); here the first is {first.shape.name!r} "
        f"({likeness_in_words(first.likeness, first.scale)})"
    ]


def _firsts(cascade: Cascade, matched: MatchedCandidates, rank_by: RankBy) -> dict[RankBy, int]:
    """Return the index of the first candidate by each other order."""
    by_scores = [order for order in ORDERS if order not in (rank_by, "combined")]
    firsts: dict[RankBy, int] = {order: int(ranked(matched, order)[0]) for order in by_scores}
    if matched.log_odds is not None:
        if rank_by != "combined":
            firsts = {"combined": int(ranked(matched, "combined")[0]), **firsts}
        return firsts
    entries = matched.candidates.entries
    approximate = coarse_log_odds(cascade.query, entries, matched.cc)
    likely = least(-approximate, entries.shapes, DESCRIBED)
    numbers = entries.embeddings[likely].tolist()
    described = cascade.reader.descriptors(numbers)
    scores = matched.cc[likely], matched.sim[likely]
    log_odds = class_log_odds(cascade.query, matched.candidates.only(likely), numbers, described, *scores)
    return {"combined": int(likely[log_odds.argmax()]), **firsts}


async def _unit_warnings(
    container: Container, query: Query, options: SearchOptions, shapes: ShapeFilter
) -> list[str]:
    """Return a warning of the factor with the most similar shape; only if there are some, compare them."""

    def count(session: ReadSession) -> dict[float, int]:
        return {factor: shapes_repository.count(session, shapes.scaled(factor)) for factor in FACTORS}

    changes = {"top_k": 1, "rank_by": "cc", "scale": "ignore", "min_cc": None, "correspondences": False}
    options = options.model_copy(update={**changes, "partial": False})
    mistakes: list[tuple[float, int, Result]] = []
    for factor, number in (await container.database.reading(count)).items():
        if number:
            scaled = shapes.scaled(factor)
            answer = await search(container, query, options, scaled, Timings(), advise=False)
            mistakes += [(factor, number, nearest) for nearest in answer.results]
    if not mistakes:
        return []
    factor, number, nearest = max(mistakes, key=lambda mistake: mistake[2].cc)
    times = f"{factor:g}" if factor > 1.0 else f"1/{1.0 / factor:g}"
    are = "1 shape is" if number == 1 else f"{number} shapes are"
    return [
        f"no shape has the size that was asked for, but {are} at {times} times it, most similar "
        f"{nearest.shape.name!r} (cc {score_in_words(nearest.cc)}): the units of the files may differ"
    ]
