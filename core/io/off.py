"""Reading and writing OFF: counts, then vertices, then polygons."""

import re

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError
from core.io.checks import Limits, declared, triangles
from core.io.text import coordinates, counted_polygons, face_lines, plain_text, rows, take, vertex_lines
from core.mesh.mesh import Mesh

# ST, C and N announce texture coordinates, colours and normals after the position. 4OFF and nOFF have another
# number of coordinates, and OFF BINARY is another format.
_HEADER = re.compile(rb"[ \t]*(?:(?:ST)?C?N?OFF|off)(?![ \t]+BINARY)", re.ASCII)


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the vertices of an OFF, shape (n, 3), and its faces as triangles, shape (f, 3)."""
    lines = rows(plain_text(data), comment=b"#")
    first = next(lines, b"")
    header = _HEADER.match(first)
    if header is None:
        raise MalformedMeshError("the file does not begin with OFF")
    counts = first[header.end() :].split() or next(lines, b"").split()
    if len(counts) < 2 or not all(count.isdigit() for count in counts):
        raise MalformedMeshError("the numbers of vertices and faces do not follow the word OFF")
    vertices, polygons = int(counts[0]), int(counts[1])
    declared(vertices, len(data), limits.vertices, "vertices")
    declared(polygons, len(data), limits.faces, "faces")
    positions = coordinates(take(lines, vertices, "vertices"))
    corners, sizes = counted_polygons(take(lines, polygons, "faces"))
    if next(lines, None) is not None:
        raise MalformedMeshError("the OFF goes on after the last face that it declares")
    return positions, triangles(corners, sizes, vertices, limits)


def write(mesh: Mesh) -> bytes:
    """Return a mesh as an OFF with the exact coordinates, in the fewest digits that restore them."""
    counts = b"OFF\n%d %d 0\n" % (len(mesh.vertices), len(mesh.faces))
    return counts + vertex_lines(mesh.vertices, "%r %r %r\n") + face_lines(mesh.faces, "3 %d %d %d\n")
