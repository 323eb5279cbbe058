"""The score `combined` of one embedding with others, by the descriptors that embeddings hold."""

from collections.abc import Sequence

from core.arrays import Floats
from core.embedding import Embedding, Scores
from core.ranking.local_density import LocalDensities
from core.ranking.opinion_pool import pooled_probability
from core.ranking.pair_differences import descriptors_of, differences_of


def combined_scores(
    query: Embedding,
    others: Sequence[Embedding],
    scores: Scores,
    own: LocalDensities | None = None,
    densities: LocalDensities | None = None,
) -> Floats:
    """Return the probability that an embedding and each of c others are of one class, shape (c,), in [0, 1].

    Calibrated for the default setting; under other parameters only its order has a meaning.

    Parameters
    ----------
    query : Embedding
    others : sequence of Embedding
    scores : Scores
        Of the query with the others.
    own, densities : LocalDensities, optional
        Of the query, arrays of shape (1,), and of the others, shape (c,), among the stored shapes; the
        typical ones unless given.
    """
    described = [descriptors_of(other) for other in others]
    return pooled_probability(differences_of(descriptors_of(query), described, scores, own, densities))
