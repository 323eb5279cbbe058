"""Reading and writing OBJ: positions (v) and faces (f)."""

import re
from itertools import islice

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, MeshTooComplexError
from core.io.checks import Content, Limits, within
from core.io.polygons import triangles
from core.io.text import coordinates, face_lines, plain_text, polygons, vertex_lines
from core.mesh.mesh import Mesh

# A newline in front, rather than an anchor, is found by a search for the byte.
# A number sign after a point begins no comment: 1.#QNAN is a number of Microsoft's C library.
_VERTEX = re.compile(rb"\n[ \t]*[vV][ \t]([^\n#]*+(?:(?<=\.)#[^\n#]*+)*)")
# "fo" is the face of old versions.
_FACE = re.compile(rb"\n[ \t]*(?:fo?|F)[ \t]+([^ \t\n#][^\n#]*)")
_CONTINUATION = re.compile(rb"\\[ \t]*\n")
_COMMENT = re.compile(rb"(?<!\.)#[^\n]*+")
_TEXTURE_AND_NORMAL = re.compile(rb"/[^ \t\n]*")
# Lines taken at a time, because a substitution keeps every piece it makes until the last.
_BLOCK = 65_536


def read(data: bytes, limits: Limits) -> Content:
    """Return the positions of an OBJ, and its faces as triangles, counted from 0.

    Objects, groups and materials are joined. Texture coordinates, normals, colours, points and lines are left
    out, and no referenced file is opened.
    """
    text = b"\n" + plain_text(data)
    if _CONTINUATION.search(text):
        within(sum(1 for _ in _CONTINUATION.finditer(text)), limits.faces, "lines that go on")
        # A comment ends with its line all the same: many end in a folder's name.
        text = _CONTINUATION.sub(b" ", _COMMENT.sub(b"", text))
    positions = coordinates(_lines(_VERTEX, text, limits.vertices, "vertices"))
    return Content(positions, _faces(text, positions, limits))


def write(mesh: Mesh) -> bytes:
    """Return a mesh as an OBJ with the exact coordinates, in the fewest digits that restore them."""
    return vertex_lines(mesh.vertices, "v %r %r %r\n") + face_lines(mesh.faces + 1, "f %d %d %d\n")


def _positions_only(lines: list[bytes]) -> list[bytes]:
    """Return face lines without the texture and normal indices after slashes."""
    joined = b"\n".join(lines)
    if b"/" not in joined:
        return lines
    if joined.startswith(b"/") or any(bare in joined for bare in (b" /", b"\t/", b"\n/")):
        raise MalformedMeshError("a face names a texture or a normal without a vertex")
    return _TEXTURE_AND_NORMAL.sub(b"", joined).split(b"\n")


def _lines(pattern: re.Pattern[bytes], text: bytes, limit: int, things: str) -> list[bytes]:
    """Return the content of the lines of one kind; raise if there are more than the limit."""
    lines = [match[1] for match in islice(pattern.finditer(text), limit + 1)]
    if len(lines) > limit:
        raise MeshTooComplexError(f"the file has more than {limit} {things}, which is the limit")
    return lines


def _faces(text: bytes, positions: Floats, limits: Limits) -> Ints:
    """Return triangles of indices counted from 0, shape (f, 3)."""
    lines = _lines(_FACE, text, limits.faces, "faces")
    blocks = (lines[start : start + _BLOCK] for start in range(0, len(lines), _BLOCK))
    lines = [line for block in blocks for line in _positions_only(block)]
    corners, sizes = polygons(lines)
    if (corners == 0).any():
        raise MalformedMeshError("a face refers to vertex 0, but an OBJ counts from 1")
    if (corners < 0).any():
        # -1 is the last vertex given above the face, wherever the face stands.
        vertex_offsets = np.fromiter((match.start() for match in _VERTEX.finditer(text)), dtype=np.int64)
        face_offsets = np.fromiter((match.start() for match in _FACE.finditer(text)), dtype=np.int64)
        above = np.repeat(np.searchsorted(vertex_offsets, face_offsets), sizes)
        if (corners < -above).any():
            raise MalformedMeshError("a face counts back past the first vertex")
        corners = np.where(corners < 0, corners + above + 1, corners)
    return triangles(corners - 1, sizes, positions, limits)
