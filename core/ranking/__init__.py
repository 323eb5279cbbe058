"""Ranking of many candidates.

Signatures, coarse samples, points or scores in; a shortlist, approximate scores or class probabilities out.
"""

__all__ = [
    "coarse_differences",
    "coarse_ranking",
    "combined",
    "density_sample",
    "likeness",
    "local_density",
    "opinion_pool",
    "pair_differences",
    "quantised_points",
    "reranking",
    "shortlist",
    "similarity_map",
    "spectral_distance",
]
