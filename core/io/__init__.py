"""Meshes from files and files from meshes: STL, OBJ, PLY, OFF and GLB; from files alone: 3MF and STEP.

Each of the first has a check, in plain code, that compares what a file declares with what it holds and
writes it anew in the plainest form of its format: positions and triangles. trimesh reads only that, and must
find as many of both. 3MF is read by code of its own over zipfile and expat. STEP is made a GLB by cascadio,
and checked as one.

The names below are imported when they are first used: the names of the formats need no reader.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.io.checks import DEFAULT_LIMITS, Limits
    from core.io.formats import ENDINGS, FORMATS, READABLE, WRITABLE, format_of
    from core.io.read import read_mesh
    from core.io.write import write_mesh

__all__ = [
    "DEFAULT_LIMITS",
    "ENDINGS",
    "FORMATS",
    "READABLE",
    "WRITABLE",
    "Limits",
    "format_of",
    "read_mesh",
    "write_mesh",
]

_MODULES = {
    "DEFAULT_LIMITS": "checks",
    "ENDINGS": "formats",
    "FORMATS": "formats",
    "READABLE": "formats",
    "WRITABLE": "formats",
    "Limits": "checks",
    "format_of": "formats",
    "read_mesh": "read",
    "write_mesh": "write",
}


def __getattr__(name: str) -> object:
    """Import a name of the package when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = found
    return found
