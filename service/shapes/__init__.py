"""Shapes: files and fields in; stored, listed, changed and restored records out."""

__all__ = [
    "bulk_changes",
    "bulk_schemas",
    "endpoints",
    "facet_repository",
    "facets",
    "fields",
    "file_endpoints",
    "file_repository",
    "records",
    "reembedding",
    "repository",
    "rule_repository",
    "schemas",
    "service",
    "word_repository",
]
