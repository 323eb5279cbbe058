"""Reading and writing OFF: counts, then vertices, then polygons."""

import re

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError
from core.io.checks import Content, Limits, declared
from core.io.polygons import triangles
from core.io.text import (
    coordinates,
    counted_polygons,
    face_lines,
    integers,
    plain_text,
    rows,
    take,
    vertex_lines,
)
from core.mesh.mesh import Mesh

# ST, C and N announce texture coordinates, colours and normals after the position, 4 a fourth, homogeneous
# coordinate, n a number of coordinates before the counts.
_HEADER = re.compile(rb"[ \t]*(?:(?:ST)?C?N?([4n]?)OFF|off)", re.ASCII)
_BINARY = re.compile(rb"[ \t]*\w*OFF[ \t]+BINARY", re.ASCII)
# Some files leave the word out.
_COUNTS = re.compile(rb"()(?=[ \t]*\d+[ \t]+\d+[ \t]+\d+[ \t\n]*\Z)")


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices of an OFF, and its faces as triangles."""
    if _BINARY.match(data):
        raise MalformedMeshError("the OFF is binary, which is not read: export it as text")
    lines = rows(plain_text(data), comment=b"#")
    first = next(lines, b"")
    header = _HEADER.match(first) or _COUNTS.match(first)
    if header is None:
        raise MalformedMeshError("the file does not begin with OFF, or is an OFF of another kind")
    width = 4 if header[1] == b"4" else 3
    counts = first[header.end() :].split() or next(lines, b"").split()
    if header[1] == b"n":
        if counts[:1] != [b"3"]:
            raise MalformedMeshError("the OFF has another number of coordinates than three")
        counts = counts[1:] or next(lines, b"").split()
    counts, rest = counts[:3], counts[3:]
    if len(counts) < 2 or not all(count.isdigit() for count in counts):
        raise MalformedMeshError("the numbers of vertices and faces do not follow the word OFF")
    vertices, polygons = int(counts[0]), int(counts[1])
    declared(vertices, len(data), limits.vertices, "vertices")
    declared(polygons, len(data), limits.faces, "faces")
    body = [*([b" ".join(rest)] if rest else []), *lines]
    warnings: tuple[str, ...] = ()
    try:
        lines = iter(body)
        positions = coordinates(take(lines, vertices, "vertices"), range(width))
        corners, sizes = counted_polygons(take(lines, polygons, "faces"))
        if next(lines, None) is not None:
            warnings = ("the OFF goes on after the last face that it declares; the rest is left out",)
    except MalformedMeshError:
        content = _wrapped(b" ".join(body).split(), vertices, polygons, width)
        if content is None:
            raise
        positions, corners, sizes = content
    if width == 4:
        positions = positions[:, :3] / positions[:, 3:]
    return Content(positions, triangles(corners, sizes, positions, limits), warnings)


def _wrapped(
    tokens: list[bytes], vertices: int, polygons: int, width: int
) -> tuple[Floats, Ints, Ints] | None:
    """Return the content of an OFF whose rows are not lines; None if its numbers end elsewhere.

    A vertex has `width` coordinates.
    """
    start = width * vertices
    rows = [b" ".join(tokens[i : i + width]) for i in range(0, start, width)]
    positions = coordinates(rows, range(width))
    corners: list[bytes] = []
    sizes: list[int] = []
    while len(sizes) < polygons and start < len(tokens) and tokens[start].isdigit():
        sizes.append(int(tokens[start]))
        corners += tokens[start + 1 : start + 1 + sizes[-1]]
        start += 1 + sizes[-1]
    if len(sizes) < polygons or start != len(tokens):
        return None
    return positions, integers(corners), np.array(sizes, dtype=np.int64)


def write(mesh: Mesh) -> bytes:
    """Return a mesh as an OFF with the exact coordinates, in the fewest digits that restore them."""
    counts = b"OFF\n%d %d 0\n" % (len(mesh.vertices), len(mesh.faces))
    return counts + vertex_lines(mesh.vertices, "%r %r %r\n") + face_lines(mesh.faces, "3 %d %d %d\n")
