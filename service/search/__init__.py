"""Search: a mesh or a stored id in, the most similar stored shapes with their scores out."""

__all__ = [
    "answer",
    "caches",
    "compare",
    "compare_schemas",
    "endpoints",
    "families",
    "likeness",
    "local_difference",
    "map",
    "neighbours",
    "part_instances",
    "plates",
    "records",
    "repository",
    "schemas",
    "scoring",
    "suggestion_schemas",
    "suggestions",
    "transfer_schemas",
    "transfers",
]
