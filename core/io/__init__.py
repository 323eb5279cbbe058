"""Mesh files: bytes in, a mesh out, and back; `core.io.formats` has the table of the formats.

Readers compare the counts that a file declares with its content before memory is allocated. NumPy parses
coordinates. 3MF is read with zipfile and expat. cascadio converts STEP to GLB.

The names below are imported on first use: the names of the formats need no reader.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.io.checks import DEFAULT_LIMITS, Limits
    from core.io.formats import FORMATS, Form, Format, by_ending, format_of, readable, writable
    from core.io.parts import PATH_NAMES, Part, clean_name
    from core.io.read import MeshFile, read_file, read_mesh, read_parts, write_mesh

__all__ = [
    "DEFAULT_LIMITS",
    "FORMATS",
    "PATH_NAMES",
    "Form",
    "Format",
    "Limits",
    "MeshFile",
    "Part",
    "by_ending",
    "clean_name",
    "format_of",
    "read_file",
    "read_mesh",
    "read_parts",
    "readable",
    "writable",
    "write_mesh",
]

_MODULES = {
    **dict.fromkeys(("DEFAULT_LIMITS", "Limits"), "checks"),
    **dict.fromkeys(
        ("FORMATS", "Form", "Format", "by_ending", "format_of", "readable", "writable"), "formats"
    ),
    **dict.fromkeys(("PATH_NAMES", "Part", "clean_name"), "parts"),
    **dict.fromkeys(("MeshFile", "read_file", "read_mesh", "read_parts", "write_mesh"), "read"),
}


def __getattr__(name: str) -> object:
    """Import a name of the package when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
