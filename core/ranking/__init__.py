"""Ranking of many candidates.

Signatures, coarse samples or scores in; a shortlist, approximate scores or class probabilities out.
"""

__all__ = ["class_probability", "coarse_ranking", "reranking", "shortlist"]
