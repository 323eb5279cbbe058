"""Shapes: files and fields in; stored, listed, changed and restored records out."""

__all__ = [
    "assemblies",
    "assembly_schemas",
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
    "size_words",
    "uploads",
]
