"""Ranking of many candidates.

Signatures, coarse samples or scores in; a shortlist, approximate scores or class probabilities out.
"""

__all__ = [
    "class_probability",
    "coarse_evidence",
    "coarse_ranking",
    "combined",
    "density_sample",
    "evidence",
    "likeness",
    "local_density",
    "opinion_pool",
    "reranking",
    "shortlist",
    "spectral_distance",
]
