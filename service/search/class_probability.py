"""The score by which answers are ranked as `combined`, and the probability that it stands for."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.descriptor_distance import DescriptorDistance, descriptor_distance
from core.embedding import Scores
from core.pipeline import Pipeline
from core.ranking.coarse_differences import TYPICAL_SIM
from core.ranking.opinion_pool import pooled_log_odds
from core.ranking.pair_differences import differences_of
from service.container import Container
from service.search.batches import by_threads, in_batches
from service.search.coarse_log_odds import coarse_log_odds
from service.search.descriptors import stored_descriptors
from service.search.records import Query
from service.search.shortlist import Candidates

DESCRIPTOR_BATCH = 64
"""Shapes whose descriptors a thread compares at a time."""


async def class_scores(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    """The class scores of c candidates by their CC and sim, shape (c,), computed by the threads that score.

    See `class_scores_of`.
    """

    def scores(places: NDArray[np.intp]) -> Floats:
        return class_scores_of(container, query, candidates.only(places), cc[places], sim[places])[None]

    places, workers = np.arange(len(candidates.shapes)), container.settings.workers
    found = await in_batches(places, DESCRIPTOR_BATCH, workers, 1, by_threads(container, scores))
    return np.asarray(found[0])


def class_scores_of(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    """The class scores of c candidates by their CC and sim, shape (c,); the least for one deleted meanwhile.

    The score is the log odds that two shapes are of one class, which do not saturate. For pipelines that do
    not pool experts it is the probability itself.
    """
    found = _log_odds if query.active_pipeline.pipeline.pools_experts else _probabilities
    return found(container, query, candidates, cc, sim)


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


def _log_odds(container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats) -> Floats:
    numbers = candidates.embeddings.tolist()
    known = stored_descriptors(container, numbers)
    present = [place for place, number in enumerate(numbers) if number in known]
    found = np.full(len(numbers), -np.inf)
    if not present:
        return found
    shapes = [known[numbers[place]] for place in present]
    sample, densities = candidates.sample, None
    if sample is not None:
        densities = sample.of_stored([numbers[place] for place in present], shapes)
    scores = Scores(cc[present], np.zeros(len(present)), sim[present])
    differences = differences_of(query.descriptors, shapes, scores, candidates.density, densities)
    found[present] = pooled_log_odds(differences)
    return found


def _probabilities(
    container: Container, query: Query, candidates: Candidates, cc: Floats, sim: Floats
) -> Floats:
    pipeline, own, signatures = query.active_pipeline.pipeline, query.spin_images, candidates.signatures
    if not own.size:
        return pipeline.combined(cc, sim, candidates.signature, signatures)
    numbers = candidates.embeddings.tolist()
    known = stored_descriptors(container, numbers)
    present = [p for p, number in enumerate(numbers) if number in known and known[number].spin_images.size]
    found = descriptor_distance(own, [known[numbers[place]].spin_images for place in present])
    distance, part = np.full(len(numbers), np.inf), np.full(len(numbers), False)
    distance[present], part[present] = found.distance, found.part
    return pipeline.combined(cc, sim, candidates.signature, signatures, DescriptorDistance(distance, part))
