"""Meshes from files and files from meshes: STL, OBJ, PLY, OFF and GLB; from files alone: 3MF and STEP.

Each of the first has a check, in plain code, that compares what a file declares with what it holds and
writes it anew in the plainest form of its format: positions and triangles. trimesh reads only that, and must
find as many of both. 3MF is read by code of its own over zipfile and expat. STEP is made a GLB by cascadio,
and checked as one.
"""

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
