"""Meshes from files and files from meshes: STL, OBJ, PLY, OFF and GLB.

Every format has a check, in plain code, that compares what a file declares with what it holds and writes it
anew in the plainest form of its format: positions and triangles. trimesh reads only that, and must find as
many of both.
"""

from core.reading.names import FORMATS, format_of
from core.reading.plain import DEFAULT_LIMITS, Limits
from core.reading.read import read_mesh
from core.reading.write import write_mesh

__all__ = ["DEFAULT_LIMITS", "FORMATS", "Limits", "format_of", "read_mesh", "write_mesh"]
