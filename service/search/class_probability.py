"""The score by which answers are ranked as `combined`, and the probability that it stands for."""

import numpy as np
from scipy.special import expit
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats, Ints
from core.descriptors.descriptor_distance import DescriptorDistance, descriptor_distance
from core.embedding import Scores
from core.pipeline import Pipeline
from core.ranking.coarse_differences import TYPICAL_SIM
from core.ranking.opinion_pool import pooled_log_odds
from core.ranking.pair_differences import differences_of
from service.container import Container
from service.search.batches import by_embedding, by_threads
from service.search.coarse_log_odds import coarse_log_odds
from service.search.descriptors import stored_descriptors
from service.search.records import Query
from service.search.shortlist import Candidates

DESCRIPTOR_BATCH = 64
"""Shapes whose descriptors a thread compares at a time."""


async def class_scores(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    """The class scores of c candidates by their CC and sim, shape (c,); the least for one deleted meanwhile.

    The score is the log odds that two shapes are of one class, which do not saturate. For pipelines that do
    not pool experts it is the probability itself.
    """
    if query.active_pipeline.pipeline.pools_experts:
        return await _log_odds(container, query, candidates, cc, sim)
    return await _probabilities(container, query, candidates, cc, sim)


def probabilities(pipeline: Pipeline, class_scores: Floats) -> Floats:
    """The class probabilities of class scores, shape (c,), in [0, 1]."""
    return np.asarray(expit(class_scores)) if pipeline.pools_experts else class_scores


def unknown_sim(pipeline: Pipeline, count: int) -> Floats:
    """The sim that stands for those of candidates that were only re-ranked, shape (count,)."""
    return np.full(count, TYPICAL_SIM if pipeline.pools_experts else 0.0)


def coarse_class_scores(query: Query, candidates: Candidates, cc: Floats) -> Floats:
    """Class scores of c candidates by approximate CC and short descriptors alone, shape (c,)."""
    pipeline = query.active_pipeline.pipeline
    if not pipeline.pools_experts:
        return pipeline.combined(cc, np.zeros(len(cc)), candidates.signature, candidates.signatures)
    return coarse_log_odds(
        query, candidates.signatures, candidates.view_signatures, candidates.reliabilities, cc
    )


async def _log_odds(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    sample, own = candidates.sample, query.descriptors
    query_density = None if sample is None else await run_in_threadpool(sample.of_query, own)
    unique, first = np.unique(candidates.embeddings, return_index=True)

    def log_odds(embeddings: Ints) -> Floats:
        numbers = embeddings.tolist()
        known = stored_descriptors(container, numbers)
        present = [place for place, number in enumerate(numbers) if number in known]
        found = np.full((1, len(numbers)), -np.inf)
        if present:
            shapes = [known[numbers[place]] for place in present]
            densities = None if sample is None else sample.of_stored([numbers[p] for p in present], shapes)
            places = first[np.searchsorted(unique, embeddings[present])]
            scores = Scores(cc[places], np.zeros(len(places)), sim[places])
            found[0, present] = pooled_log_odds(differences_of(own, shapes, scores, query_density, densities))
        return found

    score = by_threads(container, log_odds)
    log_odds_of_all: Floats = (await by_embedding(container, candidates, DESCRIPTOR_BATCH, 1, score))[0]
    return log_odds_of_all


async def _probabilities(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    pipeline, own = query.active_pipeline.pipeline, query.spin_images
    signatures = candidates.signatures
    if not own.size:
        return pipeline.combined(cc, sim, candidates.signature, signatures)

    def distances(embeddings: Ints) -> Floats:
        numbers = embeddings.tolist()
        known = stored_descriptors(container, numbers)
        present = [
            place
            for place, number in enumerate(numbers)
            if number in known and known[number].spin_images.size
        ]
        found = descriptor_distance(own, [known[numbers[place]].spin_images for place in present])
        distances_and_parts = np.full((2, len(numbers)), np.inf)
        distances_and_parts[0, present], distances_and_parts[1, present] = found.distance, found.part
        return distances_and_parts

    distance, part = await by_embedding(
        container, candidates, DESCRIPTOR_BATCH, 2, by_threads(container, distances)
    )
    return await run_in_threadpool(
        pipeline.combined,
        cc,
        sim,
        candidates.signature,
        signatures,
        DescriptorDistance(distance, part == 1.0),
    )
