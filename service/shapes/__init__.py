"""Shapes: files and fields in; stored, listed, changed and restored records out."""

__all__ = [
    "documentation",
    "endpoints",
    "fields",
    "files",
    "filters",
    "pages",
    "records",
    "reembedding",
    "repository",
    "schemas",
    "service",
]
