"""Many candidates put in order.

Signatures, coarse samples or scores in; a shortlist, rough scores or class probabilities out.
"""

__all__ = ["class_probability", "coarse_ranking", "reranking", "shortlist"]
