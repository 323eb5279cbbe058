"""The score `combined` of one embedding with others, by the descriptors that embeddings hold."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Floats
from core.descriptors.descriptor_distance import descriptor_distance
from core.embedding import Embedding, Scores
from core.parameters import RankingParameters
from core.ranking.class_probability import class_probability, signature_features
from core.ranking.local_density import LocalDensities
from core.ranking.opinion_pool import pooled_probability
from core.ranking.pair_differences import descriptors_of, differences_of


def pools_experts(ranking: RankingParameters) -> bool:
    """Whether embeddings hold all descriptors of `core.ranking.pair_differences`."""
    return ranking.views and ranking.spin_images and ranking.global_descriptors


def combined_scores(
    query: Embedding,
    others: Sequence[Embedding],
    scores: Scores,
    ranking: RankingParameters,
    own: LocalDensities | None = None,
    densities: LocalDensities | None = None,
) -> Floats:
    """The probability that one embedding and each of c others are of one class, shape (c,), in [0, 1].

    Parameters
    ----------
    query : Embedding
    others : sequence of Embedding
    scores : Scores
        Of the query with the others.
    ranking : RankingParameters
        Of the embeddings.
    own, densities : LocalDensities, optional
        Of the query, arrays of shape (1,), and of the others, shape (c,), among the stored shapes; the
        typical ones unless given. Only where experts are pooled do they count.
    """
    if pools_experts(ranking):
        described = [descriptors_of(other) for other in others]
        return pooled_probability(differences_of(descriptors_of(query), described, scores, own, densities))
    signatures = np.array([other.signature for other in others]).reshape(-1, len(query.signature))
    between = (
        descriptor_distance(query.spin_images, [other.spin_images for other in others])
        if query.spin_images.size
        else None
    )
    whole = signature_features(
        scores.cc, scores.sim, query.signature, signatures, global_descriptors=ranking.global_descriptors
    )
    return class_probability(whole, between)
