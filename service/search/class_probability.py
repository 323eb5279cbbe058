"""The score by which answers are ranked as `combined`, and the probability that it stands for."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.embedding import Scores
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import differences_of
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

    The score is the log odds that two shapes are of one class, which do not saturate.
    """
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


def probabilities(class_scores: Floats) -> Floats:
    """Return the class probabilities of class scores, shape (c,), in [0, 1]."""
    return np.asarray(expit(class_scores))


def coarse_class_scores(query: Query, candidates: Candidates, cc: Floats) -> Floats:
    """Return class scores of c candidates by approximate CC and short descriptors alone, shape (c,)."""
    return coarse_log_odds(
        query, candidates.signatures, candidates.view_signatures, candidates.reliabilities, cc
    )
