"""Every hostile file, and the answer that it must get."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.errors import PROBLEMS
from tests.core.io.files import PLAIN
from tests.core.shapes import rectangle
from tests.soak.hostile import every_format, gltf, packages, polygons, text

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
LIMIT = 128 << 20


def _million(format: str) -> bytes:
    """Return a hilly square in few digits, as programs write them: seventeen would be too many for an OBJ."""
    flat = rectangle(1, 1, 999, 999)
    hills = np.sin(7 * flat.vertices[:, :1]) * np.cos(5 * flat.vertices[:, 1:2])
    return write_mesh(Mesh(np.round(flat.vertices + 0.2 * hills * [0, 0, 1], 6), flat.faces), format)


def _fans() -> bytes:
    """Return few polygons with 4,000,001 triangles."""
    polygon = b"10003 " + b"0 1 2 " * 3334 + b"0\n"
    return b"OFF\n3 401 0\n0 0 0\n1 0 0\n0 1 0\n" + polygon * 401


AT_THE_LIMITS = {
    ("million", ""): {f"million.{format}": lambda format=format: _million(format) for format in PLAIN},
    ("limit", "mesh-too-complex"): {
        "vertices.off": lambda: b"OFF\n2000001 1 0\n" + b"0 1 2\n" * 2_000_001 + b"3 0 1 2\n",
        "faces.obj": lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 4_000_001,
        "fans.off": _fans,
    },
    ("limit", "body-too-large"): {
        "bytes.off": lambda: b"x" * (LIMIT + 1),
        "bytes.stl": lambda: bytes(2 * LIMIT),
    },
}
# Twenty thousand parts take seconds to embed.
SLOW = {"spaces.3mf", *(f"loose.{format}" for format in PLAIN if format != "stl")}


@dataclass(frozen=True)
class Hostile:
    """A file: its row of `ROWS`, its name, what makes it, and the kind of problem; "" if it is stored."""

    row: str
    filename: str
    make: Callable[[], bytes]
    kind: str

    @property
    def answer(self) -> str:
        """The HTTP status of the answer, and the kind of problem."""
        return f"{PROBLEMS[self.kind].status} {self.kind}" if self.kind else "201"

    @property
    def slow(self) -> bool:
        """Whether it is too large to be sent more than once."""
        return self.row in {"limit", "million"} or self.filename in SLOW


def _hostile(table: Mapping[tuple[str, str], Mapping[str, bytes | Callable[[], bytes]]]) -> list[Hostile]:
    return [
        Hostile(row, name, content if callable(content) else lambda content=content: content, kind)
        for (row, kind), files in table.items()
        for name, content in files.items()
    ]


CORPUS = [
    case
    for table in (*(module.CASES for module in (every_format, polygons, gltf, packages, text)), AT_THE_LIMITS)
    for case in _hostile(table)
]
