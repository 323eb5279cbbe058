"""The pictures of a report, drawn from previews: shapes and corresponding points."""

import json
import struct
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats
from core.io import read_mesh
from core.mesh.mesh import Mesh
from service.rendering.colours import colours_of_points
from service.rendering.thumbnail import draw, draw_painted, upright
from service.search.schemas import Pair

SIZE = 256
"""Pixels on each side of a picture."""

_GLB = "glb"
# The offsets of the length of the JSON, after the header of the file, and of the JSON itself.
_LENGTH, _JSON = 12, 20


@dataclass(frozen=True, eq=False)
class Preview:
    """The preview of a shape by the service.

    Attributes
    ----------
    mesh : Mesh
        With y up and coordinates in [-1, 1].
    placing : float64, shape (3, 4)
        Maps a point (x, y, z, 1) of the file to the mesh.
    """

    mesh: Mesh
    placing: Floats

    @classmethod
    def of(cls, glb: bytes, format: str) -> "Preview":
        """Read a preview from its GLB and the format of the original file."""
        (length,) = struct.unpack_from("<I", glb, _LENGTH)
        (node,) = json.loads(glb[_JSON : _JSON + length])["nodes"]
        middle, half = np.array(node["extras"]["middle"]), float(node["extras"]["half"])
        turn = upright(format) / half
        return cls(read_mesh(glb, _GLB), np.hstack([turn, -(turn @ middle)[:, None]]))

    def placed(self, points: Floats) -> Floats:
        """Points of the file, shape (p, 3), in the frame of the mesh."""
        return np.asarray(points @ self.placing[:, :3].T + self.placing[:, 3])


def alone(shape: Preview) -> bytes:
    """Return a PNG of a shape."""
    return draw(shape.mesh, _GLB, SIZE)


def matched(first: Preview, second: Preview, pairs: list[Pair]) -> tuple[bytes, bytes]:
    """Return a PNG of each of two shapes; corresponding points have one colour."""
    ends = [
        shape.placed(np.array([point.position for point in points]))
        for shape, points in (
            (first, [pair.first for pair in pairs]),
            (second, [pair.second for pair in pairs]),
        )
    ]
    colours = colours_of_points(ends[0], np.eye(3))
    return (
        draw_painted(first.mesh, _GLB, SIZE, ends[0], colours),
        draw_painted(second.mesh, _GLB, SIZE, ends[1], colours),
    )
