"""The candidates of a query and their scores, in batches on the threads of the service.

The candidates are all shapes that match the filter of the query, or a shortlist of them. The cascade: a
shortlist is re-ranked by the coarse samples in memory, and the best are matched in full.
"""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from inspect import iscoroutinefunction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Float32s, Floats, Ints
from core.descriptors.partial import is_part, part_distances, whole_spin_images
from core.descriptors.registry import ShapeDescriptors
from core.descriptors.spin_images import KEYPOINTS
from core.embedding import Scores
from core.matching.match_records import match_record, score_match_records
from core.parameters import Parameters
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import TYPICAL_SIM, CoarseDescriptors, coarse_differences, differences_of
from core.ranking.local_density import LocalDensities, typical_densities
from core.ranking.reranking import rerank
from core.ranking.shortlist import least
from service.compute.request_queue import short_of_memory
from service.compute.tasks import part_of_mesh, score_embeddings
from service.container import Container
from service.index.repository import IndexEntries
from service.observability.logging import get_logger
from service.observability.metrics import Timings
from service.search.caches import BatchReader, CandidateReader, collection_sample
from service.search.records import Candidates, MatchedCandidates, Query
from service.search.signature_index import Wanted, signature_index
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter

log = get_logger("search")

MATCH_BATCH, DESCRIPTOR_BATCH, RERANK_BATCH, PROCESS_BATCH = 48, 64, 96, 256
"""Most embeddings that a thread matches, compares by descriptors or re-ranks at a time, and that a worker
process matches."""

LONGER = 4
"""Factor of these lengths for queries that run side by side: they keep the workers busy together."""

DESCRIBED = 1.0 / 4.0
"""Share of the re-ranked candidates whose descriptors are read, if log odds rank the answer."""

SKIPPED = frozenset({"spin_images"})
"""Descriptors that re-ranking does not compare with those of a complete query: their distances take most of
the time, and do not change which candidates are matched in full."""

VIEW_SHARE = 0.5
"""Shapes near by view signatures in a shortlist, for each one near by signatures."""


def find_candidates(
    container: Container, query: Query, shapes: ShapeFilter, shortlist_from: int | None, *, by_log_odds: bool
) -> Candidates:
    """Return the shapes that match a filter, without the query itself, or a shortlist of them.

    Stages: read the collection's sample for local densities; select by the filter; of `shortlist_from` shapes
    or more, unless it is None, keep the nearest by signatures and by view signatures. If log odds rank the
    answer, more of both are looked for, and those of greatest approximate log odds stay.
    """
    index = signature_index(container, query.active_pipeline)
    length, by_views = container.settings.shortlist_length, VIEW_SHARE
    if by_log_odds:
        length, by_views = index.widening * length, 1.0
    with container.database.read() as session:
        stored = shapes_repository.stored(session, shapes.collection)
        sample = collection_sample(session, container, query.active_pipeline, shapes.collection)
        neighbours = length, math.ceil(by_views * length)
        wanted = Wanted(query, shapes, stored, shortlist_from, *neighbours)
        entries, shortlisted = index.candidates(session, wanted)
    if shortlisted and by_log_odds:
        log_odds = coarse_log_odds(query, entries)
        entries = entries.only(least(-log_odds, entries.shapes, container.settings.shortlist_length))
    # The index of an empty archive has signatures of length 0.
    signatures = entries.signatures.reshape(len(entries.shapes), len(query.embedding.signature))
    entries = replace(entries, signatures=signatures)
    return Candidates(entries, shortlisted, stored, sample, sample.of_query(query.descriptors))


@dataclass(frozen=True, eq=False)
class Cascade:
    """The stages that score the candidates of one query.

    `by_log_odds` says whether log odds rank the answer. Otherwise approximate CC stands for cc, ssd and sim
    in re-ranking.
    """

    container: Container
    query: Query
    reader: CandidateReader
    by_log_odds: bool = False

    @property
    def parameters(self) -> Parameters:
        """The parameters of the query's pipeline."""
        return self.query.active_pipeline.pipeline.parameters

    async def score(self, candidates: Candidates, top_k: int) -> MatchedCandidates:
        """Match the candidates, each embedding once; of a shortlist, only the best of the re-ranking.

        The full match has as many more candidates than `top_k` as the setting of finalists says. Deleted and
        unreadable candidates are left out. The matches have log odds if these rank the answer.
        """
        with self.container.searches.running():
            if self.query.active_pipeline.pipeline.matcher.uses_match_records:
                record = await run_in_threadpool(self._match_record)
                finalists = self.container.settings.finalists + top_k
                if candidates.shortlisted and finalists < len(candidates):
                    candidates = await self._rerank(record, candidates, finalists)
                match: Callable[[Ints], Any] = partial(self._match, record, candidates)
                length = MATCH_BATCH
            else:
                match, length = partial(self._match_in_worker, candidates), PROCESS_BATCH
            scores = await self.in_batches(match, candidates.entries.embeddings, length)
        known = np.asarray(np.isfinite(scores[:3]).all(axis=0))
        if not known.all():
            log.warning("%d candidates were deleted meanwhile, or cannot be read", np.count_nonzero(~known))
        cc, ssd, sim, log_odds = scores
        return MatchedCandidates(candidates, cc, ssd, sim, log_odds if self.by_log_odds else None).only(known)

    async def in_batches(self, score: Callable[[Ints], Any], rows: Ints, length: int) -> Floats:
        """Score r numbers in batches, two a worker at a time, and return k scores of each, shape (k, r).

        `score` is a coroutine function, or runs on the threads of the service; it returns an array of shape
        (k, b) for b different numbers, at most `length`. All batches have the same length, but for the last,
        and there are about as many for each worker, so that the workers end together. If the query is
        cancelled, or a batch fails, batches that have not begun are cancelled. A query of several side by
        side has longer batches, two at a time.
        """
        numbers, inverse = np.unique(rows, return_inverse=True)
        workers = self.container.settings.workers
        if isinstance(self.reader, BatchReader):
            workers, length = 1, LONGER * length
        count = workers * max(1, math.ceil(len(numbers) / (workers * length)))
        length = max(1, math.ceil(len(numbers) / count))
        batches: list[asyncio.Task[Floats]] = []
        pending: set[asyncio.Task[Floats]] = set()

        async def on_thread(part: Ints) -> Floats:
            async with self.container.batches.turn():
                return await asyncio.wrap_future(self.container.threads.submit(score, part))

        try:
            with short_of_memory():
                for start in range(0, max(1, len(numbers)), length):
                    if len(pending) == 2 * workers:
                        done, pending = await asyncio.wait(pending, return_when=asyncio.FIRST_COMPLETED)
                        for batch in done:
                            batch.result()
                    part = numbers[start : start + length]
                    batch = asyncio.create_task(
                        score(part) if iscoroutinefunction(score) else on_thread(part)
                    )
                    batches.append(batch)
                    pending.add(batch)
                await asyncio.gather(*pending)
        finally:
            for batch in pending:
                batch.cancel()
        return np.concatenate([batch.result() for batch in batches], axis=1)[:, inverse]

    def _match_record(self) -> Float32s:
        """Return the match record of the query, cached if the query is a stored shape."""
        query = self.query
        cached = {} if query.number is None else query.active_pipeline.cache.get([query.number])
        return (
            cached[query.number] if query.number in cached else match_record(query.embedding, self.parameters)
        )

    async def _rerank(self, record: Float32s, candidates: Candidates, count: int) -> Candidates:
        """Return the best candidates by re-ranking, and by descriptors if log odds rank the answer.

        Coarse log odds choose the candidates whose descriptors are read, and their local densities are
        estimated. Of an incomplete query, all descriptors are read, and densities computed, since the log
        odds depend mostly on spin images.
        """
        coarse_samples = candidates.entries.coarse_samples

        def match_samples(rows: Ints) -> Floats:
            return rerank(record, coarse_samples[rows], self.parameters)[None].astype(float)

        (cc,) = await self.in_batches(match_samples, np.arange(len(candidates)), RERANK_BATCH)
        if not self.by_log_odds:
            return _best(candidates, cc, count)[0]
        estimates: LocalDensities | None = None
        if not is_part(self.query.spin_images):
            estimates = await run_in_threadpool(_estimated_densities, candidates)
            described = max(count, math.ceil(len(cc) * DESCRIBED))
            log_odds = coarse_log_odds(self.query, candidates.entries, cc, (candidates.density, estimates))
            candidates, indices = _best(candidates, log_odds, described)
            cc, estimates = cc[indices], estimates.only(indices)

        def compare_descriptors(rows: Ints) -> Floats:
            numbers = candidates.entries.embeddings[rows].tolist()
            sim = np.full(len(rows), TYPICAL_SIM)
            described = self.reader.descriptors(numbers)
            densities = None if estimates is None else estimates.only(rows)
            return class_log_odds(self.query, candidates, numbers, described, cc[rows], sim, densities)[None]

        (scores,) = await self.in_batches(compare_descriptors, np.arange(len(cc)), DESCRIPTOR_BATCH)
        return _best(candidates, scores, count)[0]

    def _match(self, record: Float32s, candidates: Candidates, embeddings: Ints) -> Floats:
        """Match c embeddings by their records: CC, SSD, sim and, where asked for, log odds, shape (4, c)."""
        numbers = embeddings.tolist()
        records, described = self.reader.match_records(numbers, descriptors=self.by_log_odds)
        present = [number for number in numbers if number in records]
        matched = self._matched(record, {number: records[number] for number in present})
        return self._all_scores(candidates, numbers, present, matched, described)

    def _matched(self, record: Float32s, records: dict[int, Float32s]) -> Scores:
        """Match the query with c records, by number; a pair of two queries of a batch is matched once."""
        reader, number = self.reader, self.query.number
        if not isinstance(reader, BatchReader) or number is None:
            return score_match_records(record, list(records.values()), self.parameters)
        known = {other: reader.pairs[other, number] for other in records if (other, number) in reader.pairs}
        missing = [other for other in records if other not in known]
        matched = score_match_records(record, [records[other] for other in missing], self.parameters)
        known |= dict(zip(missing, np.stack([matched.cc, matched.ssd, matched.sim], axis=1), strict=True))
        reader.pairs.update({(number, other): known[other] for other in reader.numbers.intersection(missing)})
        return Scores(*np.array([known[other] for other in records]).reshape(-1, 3).T)

    async def _match_in_worker(self, candidates: Candidates, embeddings: Ints) -> Floats:
        """Match c embeddings in a worker process, for pipelines without match records, as `_match` does."""
        numbers = embeddings.tolist()
        records = await run_in_threadpool(self.reader.records, numbers)
        present = [number for number in numbers if number in records]
        present_records = [records[number] for number in present]
        matched = await self.container.queue.compare(
            score_embeddings, self.query.record, present_records, self.parameters
        )
        described = await run_in_threadpool(self.reader.descriptors, numbers) if self.by_log_odds else {}
        return await run_in_threadpool(self._all_scores, candidates, numbers, present, matched, described)

    def _all_scores(
        self,
        candidates: Candidates,
        numbers: list[int],
        present: list[int],
        matched: Scores,
        described: dict[int, ShapeDescriptors],
    ) -> Floats:
        """Return the scores of c embeddings, shape (4, c), from those of `present` ones; NaN elsewhere."""
        scores = np.full((4, len(numbers)), np.nan)
        scores[:3, np.isin(numbers, present)] = matched.cc, matched.ssd, matched.sim
        if self.by_log_odds:
            scores[3] = class_log_odds(self.query, candidates, numbers, described, scores[0], scores[2])
        return scores


async def nearest_wholes(
    cascade: Cascade, candidates: Candidates, count: int, timings: Timings
) -> tuple[Candidates, dict[int, float]]:
    """Return the candidates that the query is most likely a part of, and the part distance of each shape.

    Stages: describe the query as a part; rank all candidates by
    `core.descriptors.partial.part_distances`. Deleted and unreadable candidates are left out.

    At most `count` candidates are returned, the least distance first. The mesh of the query is read if its
    record does not describe it as a part.
    """
    container, query = cascade.container, cascade.query
    with timings.stage("spin_images"):
        part = query.spin_images[KEYPOINTS:]
        if not len(part) and query.mesh is not None:
            part = await container.queue.do(part_of_mesh, await query.mesh(), cascade.parameters)

    def measure(embeddings: Ints) -> Floats:
        numbers = embeddings.tolist()
        described = cascade.reader.descriptors(numbers)
        known = [i for i, number in enumerate(numbers) if number in described]
        distances = np.full((1, len(numbers)), np.nan)
        wholes = [whole_spin_images(described[numbers[i]].arrays["spin_images"]) for i in known]
        distances[0, known] = part_distances(part, wholes)
        return distances

    with timings.stage("compare"):
        (distances,) = await cascade.in_batches(measure, candidates.entries.embeddings, DESCRIPTOR_BATCH)
        finite = np.flatnonzero(np.isfinite(distances))
        distances, candidates = distances[finite], replace(candidates.only(finite), shortlisted=False)
        shapes = candidates.entries.shapes
        distance_of = dict(zip(shapes.tolist(), distances.tolist(), strict=True))
        return candidates.only(least(distances, shapes, count)), distance_of


def _estimated_densities(candidates: Candidates) -> LocalDensities:
    """Estimate the local densities of c candidates from the index alone, arrays of shape (c,)."""
    entries = candidates.entries
    if candidates.sample is None:
        return typical_densities(len(candidates))
    return candidates.sample.estimated(entries.signatures, entries.view_signatures)


def coarse_log_odds(
    query: Query,
    entries: IndexEntries,
    cc: Floats | None = None,
    densities: tuple[LocalDensities | None, LocalDensities | None] = (None, None),
) -> Floats:
    """Compute approximate log odds that a query and c shapes are of one class, from the index alone.

    `cc` has the approximate CC of the shapes, shape (c,), as the result; CC typical of the spectral distances
    is taken unless it is given. So are typical `densities` of the query and of the shapes.
    """
    descriptors = query.descriptors
    reliability = np.array([descriptors.reliability], dtype=np.float32)
    return pooled_log_odds(
        coarse_differences(
            CoarseDescriptors(descriptors.signature[None], query.view_signature[None], reliability),
            CoarseDescriptors(entries.signatures, entries.view_signatures, entries.reliabilities),
            cc,
            *densities,
            part=is_part(query.spin_images),
        )
    )


def class_log_odds(
    query: Query,
    candidates: Candidates,
    embeddings: list[int],
    described: dict[int, ShapeDescriptors],
    cc: Floats,
    sim: Floats,
    estimates: LocalDensities | None = None,
) -> Floats:
    """Compute the log odds that a query and each of c embeddings are of one class, shape (c,).

    They are the least for embeddings without descriptors or CC, which were deleted meanwhile. `embeddings`
    has the numbers of the embeddings and `described` descriptors by number; `cc` and `sim` have shape (c,).
    Local densities are those in the sample of the candidates; without one, typical.

    With `estimates` of the densities, shape (c,), the log odds are approximate: of the densities only the
    kinds are computed, and typical distances stand for those of `SKIPPED`.
    """
    present = [i for i, number in enumerate(embeddings) if number in described and not np.isnan(cc[i])]
    log_odds = np.full(len(embeddings), -np.inf)
    if not present:
        return log_odds
    numbers = [embeddings[i] for i in present]
    shapes = [described[number] for number in numbers]
    sample, densities, skipped = candidates.sample, None, frozenset[str]()
    if estimates is not None:
        densities, skipped = estimates.only(np.array(present)), SKIPPED
        if sample is not None:
            densities = replace(densities, kinds=sample.kinds_of(shapes))
    elif sample is not None:
        densities = sample.of_stored(numbers, shapes)
    scores = Scores(cc[present], np.zeros(len(present)), sim[present])
    log_odds[present] = pooled_log_odds(
        differences_of(query.descriptors, shapes, scores, candidates.density, densities, skipped=skipped)
    )
    return log_odds


def _best(candidates: Candidates, scores: Floats, count: int) -> tuple[Candidates, NDArray[np.intp]]:
    """Return the candidates of greatest score and their indices; deleted ones come last."""
    indices = least(np.nan_to_num(-scores, nan=np.inf), candidates.entries.shapes, count)
    return candidates.only(indices), indices
