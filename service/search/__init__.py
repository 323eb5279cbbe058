"""Search: a mesh or a stored id in, the most similar stored shapes with their scores out."""

__all__ = [
    "cache_warmer",
    "compare_endpoint",
    "compare_schemas",
    "endpoints",
    "likeness",
    "likeness_words",
    "rank_by",
    "ranking",
    "records",
    "repository",
    "schemas",
    "score_words",
    "scoring",
    "service",
    "shortlist",
    "tasks",
]
