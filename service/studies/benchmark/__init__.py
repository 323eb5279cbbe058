"""The cost of the method: meshes and archives in, times, memory and ratios out; a file a subject."""

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
