"""The search for the most similar stored shapes: a query in, its answer out."""

import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TypeVar, get_args

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.io import format_of
from core.ranking.likeness import Likeness
from core.ranking.shortlist import least
from service.collection import CollectionNumber
from service.compute.request_queue import short_of_memory
from service.container import Container
from service.errors import NotEmbeddedError
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.caches import BatchReader, CandidateReader
from service.search.likeness import stored_mesh
from service.search.neighbours import in_context
from service.search.records import MatchedCandidates, Query, once
from service.search.results import (
    BestResult,
    all_likened,
    correspondence_with,
    misfit,
    parts_of,
    ranked,
    read_results,
)
from service.search.schemas import (
    QueryAnswer,
    RankBy,
    Result,
    SearchOptions,
    likeness_in_words,
    score_in_words,
)
from service.search.scoring import Cascade, class_log_odds, coarse_log_odds, find_candidates, nearest_wholes
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, sha256
from service.shapes.schemas import EmbeddingArrays, MeasuredMesh, warnings_of
from service.storage.database import ReadSession

UNITS = (10.0, 25.4, 1000.0)
"""Millimetres in a centimetre, in an inch and in a metre."""

FACTORS = (*UNITS, *(1.0 / factor for factor in UNITS))
"""Factors between the sizes of files whose units are mistaken."""

REGISTERED = 8
"""Further results that are registered with the query, if they may be copies, to find the best of these."""

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
    sized = _sized(shapes, options, query)
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
                read_results,
                cascade,
                matched.only(best[: options.top_k + by_log_odds * REGISTERED]),
                shapes.collection,
                part_distances or {},
                every_record=options.correspondences,
            )
    with timings.stage("likeness"):
        shown = await all_likened(
            container,
            query,
            [
                each
                for number, each in enumerate(best_results)
                if number < options.top_k or (each.is_certain and each.may_be_copy)
            ],
        )
        if by_log_odds:
            shown.sort(key=misfit)
        results = [
            each.result.model_copy(update={"rank": rank})
            for rank, each in enumerate(shown[: options.top_k], start=1)
        ]
        if advise and results and not options.partial:
            told = {each.number: result for each, result in zip(shown, results, strict=False)}
            warnings += await _order_warnings(cascade, matched.only(best), rank_by, told, shapes.collection)
    pieces: list[BestResult] = []
    if advise and not options.partial:
        with timings.stage("instances"):
            others = replace(
                query, excluded=query.excluded | {each.number for each in shown[: options.top_k]}
            )
            pieces = await parts_of(replace(cascade, query=others), shapes, options)
    parts = [
        each.result.model_copy(update={"rank": rank})
        for rank, each in enumerate(pieces, start=1 + len(results))
    ]
    if options.correspondences:
        with timings.stage("results"):
            for result, each in zip([*results, *parts], [*shown[: options.top_k], *pieces], strict=True):
                result.correspondence = await correspondence_with(container, query, each.surface)
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


def _shortlist_from(container: Container, options: SearchOptions) -> int | None:
    """Return the number of shapes from which a query compares a shortlist; None if it compares all."""
    if options.exhaustive:
        return None
    return math.ceil((PARTIAL_FACTOR if options.partial else 1.0) * container.settings.shortlist_from)


def _sized(shapes: ShapeFilter, options: SearchOptions, query: Query) -> ShapeFilter:
    """Return the filter with the sizes that a query asks for."""
    if options.scale == "ignore":
        return shapes
    factor, area = 1.0 + options.size_tolerance, query.embedding.facts.area
    least, greatest = area / factor**2, area * factor**2
    if shapes.area is not None:
        least, greatest = max(least, shapes.area[0]), min(greatest, shapes.area[1])
    return replace(shapes, area=(least, greatest))


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
        others = await run_in_threadpool(read_results, cascade, chosen, collection, {}, every_record=False)
    likened = await all_likened(cascade.container, cascade.query, others)
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
        f"no shape has the size that was asked for, but {are} {times} times as large (most similar: "
        f"{nearest.shape.name!r}, cc {score_in_words(nearest.cc)}): the units of the files may differ"
    ]
