"""Mesh files: bytes in, a mesh out, and back; STL, OBJ, PLY, OFF, GLB and 3MF, and STEP for reading only.

Readers compare the counts that a file declares with its content before memory is allocated. NumPy parses
coordinates. A GLB is rewritten as plain meshes and transforms, which trimesh reads. 3MF is read with zipfile
and expat. cascadio converts STEP to GLB.

The names below are imported on first use: the names of the formats need no reader.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.io.checks import DEFAULT_LIMITS, Limits
    from core.io.formats import ENDINGS, FORMATS, READABLE, WRITABLE, format_of, readable
    from core.io.part import PATH_NAMES, Part, clean_name
    from core.io.parts import read_parts
    from core.io.read import read_mesh
    from core.io.write import write_mesh

__all__ = [
    "DEFAULT_LIMITS",
    "ENDINGS",
    "FORMATS",
    "PATH_NAMES",
    "READABLE",
    "WRITABLE",
    "Limits",
    "Part",
    "clean_name",
    "format_of",
    "read_mesh",
    "read_parts",
    "readable",
    "write_mesh",
]

_MODULES = {
    "DEFAULT_LIMITS": "checks",
    "ENDINGS": "formats",
    "FORMATS": "formats",
    "PATH_NAMES": "part",
    "READABLE": "formats",
    "WRITABLE": "formats",
    "Limits": "checks",
    "Part": "part",
    "clean_name": "part",
    "format_of": "formats",
    "read_mesh": "read",
    "read_parts": "parts",
    "readable": "formats",
    "write_mesh": "write",
}


def __getattr__(name: str) -> object:
    """Import a name of the package when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = found
    return found
