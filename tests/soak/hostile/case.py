"""A hostile file, and the answer that it must get."""

from collections.abc import Callable
from dataclasses import dataclass

STORED = (201, "")
"""The answer to a file that is strange and yet a mesh."""

# Each row of the table in docs/hostile.md: a key, and the text of its first column.
ROWS = {
    "empty": "empty file",
    "cut": "truncated; wrong extension; bytes that are no mesh",
    "stl-count": "binary STL that declares up to 2^32 - 1 triangles",
    "binary-count": "OFF and binary PLY that declare 4e9 rows or corners",
    "ascii-count": "text PLY that declares 4e9 rows or corners",
    "non-finite": "NaN and infinite coordinates, or numbers that overflow",
    "index-large": "a face index past the last vertex",
    "index-negative": "a negative index; relative ones of OBJ are legal",
    "index-zero": "index 0 in OBJ",
    "no-faces": "no faces; point clouds, lines",
    "degenerate": "faces without area; one repeated point",
    "strange": "one triangle, coplanar, non-manifold, 20,000 components",
    "parts": "STL of 8,000 and 40,000 solids, OBJ of 20,000 groups, GLB of 20,000 primitives",
    "no-view": "glTF accessors without data",
    "instances": "glTF of 20,000 instances of 20,000 faces; trees of nodes that never end",
    "texture": "glTF with a texture of 40,000 x 40,000, or with broken ones",
    "reference": "other files and addresses: glTF URIs, mtllib, comments",
    "archive": "ZIP, 3MF, ZAE, gzip, bzip2, xz and 7z, up to 6 GiB in 6 MB",
    "xml": "XML entity bombs and external entities, as DAE, 3MF, X3D, SVG or under a mesh's name",
    "name": "a filename that is a path on the server, or no name at all",
    "nested": "JSON nested 100,000 deep, lines of megabytes, polygons of 100,000 corners",
    "limit": "more vertices, faces or bytes than the limits",
    "million": "1e6 vertices and 2e6 faces",
}


@dataclass(frozen=True)
class Hostile:
    """A file.

    Attributes
    ----------
    row : str
        A key of `ROWS`.
    filename : str
        As it is uploaded, and no other file's.
    make : callable
        Gives its bytes, always the same.
    status, kind : int, str
        The answer: an HTTP status and the kind of problem, "" for none.
    slow : bool
        Whether it is too large for every run of the tests.
    fatal : bool
        Whether it ends the process that reads it, so that only the service may be given it.
    """

    row: str
    filename: str
    make: Callable[[], bytes]
    status: int
    kind: str
    slow: bool = False
    fatal: bool = False


Table = dict[str, bytes | Callable[[], bytes]]


def refused(row: str, kind: str, files: Table, status: int = 422) -> list[Hostile]:
    """Files by name that are refused."""
    return [Hostile(row, name, _maker(content), status, kind) for name, content in files.items()]


def malformed(row: str, files: Table) -> list[Hostile]:
    """Files by name that are refused as no mesh of their format."""
    return refused(row, "malformed-mesh", files)


def stored(row: str, files: Table) -> list[Hostile]:
    """Files by name that are taken."""
    return [Hostile(row, name, _maker(content), *STORED) for name, content in files.items()]


def _maker(content: bytes | Callable[[], bytes]) -> Callable[[], bytes]:
    return content if callable(content) else lambda: content
