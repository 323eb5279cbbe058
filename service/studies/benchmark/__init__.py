"""Benchmarks of the method and the service: meshes and archives in; times, memory and ratios out."""

__all__ = [
    "archive",
    "embedding",
    "functional_maps",
    "growth",
    "ingesting",
    "load",
    "matching",
    "meshes",
    "page",
    "pictures",
    "plot",
    "searching",
    "table1",
]
