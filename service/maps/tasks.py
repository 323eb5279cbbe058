"""The layout of maps, in the workers."""

from core.parameters import Parameters
from core.pipeline import Pipeline
from core.ranking.coarse_differences import CoarseDescriptors
from core.ranking.similarity_map import (
    SimilarityMap,
    dissimilarities_by_log_odds,
    dissimilarities_by_signature,
    similarity_map,
)


def lay_out(shapes: CoarseDescriptors, parameters: Parameters) -> SimilarityMap:
    """The map of shapes that a pipeline has embedded."""
    if Pipeline(parameters).pools_experts and shapes.view_signatures.size:
        return similarity_map(dissimilarities_by_log_odds(shapes))
    by_signature = dissimilarities_by_signature(
        shapes.signatures, global_descriptors=parameters.ranking.global_descriptors
    )
    return similarity_map(by_signature)
