"""Shapes: files and fields in; stored, listed, changed and restored records out."""

__all__ = [
    "documentation",
    "endpoints",
    "fields",
    "file_endpoints",
    "files",
    "filters",
    "pages",
    "records",
    "reembedding",
    "repository",
    "schemas",
    "service",
    "uploads",
]
