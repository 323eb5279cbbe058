"""Ranking of many candidates.

Signatures, coarse samples, points or scores in; a shortlist, approximate scores or class probabilities out.
"""

__all__ = [
    "class_probability",
    "differences",
    "diffusion",
    "families",
    "graph_layout",
    "isometry",
    "kinds",
    "likeness",
    "local_density",
    "reranking",
    "shortlist",
    "similarity_map",
]
