"""A mesh as a small picture, plain or painted."""

from collections.abc import Callable
from io import BytesIO

import numpy as np
from PIL import Image

from core.arrays import Floats, Ints
from core.mesh.face_normals import face_normals
from core.mesh.mesh import Mesh
from service.rendering.colours import spread
from service.rendering.rasteriser import NOTHING, nearest_triangles
from service.rendering.viewpoint import camera, frame, upright

SIZES = (64, 128, 256, 512)

# Counted up when the same mesh gives another picture, so that stored ones are drawn anew.
DRAWING = 1

_SURFACE = np.array([126.0, 158.0, 201.0])
_TOWARDS_LIGHT = np.array([-0.35, 0.62, 0.70])
_FINER = 2


def draw(mesh: Mesh, format: str, size: int) -> bytes:
    """A PNG of `size` pixels a side: the mesh lit from the upper left, on nothing (transparent).

    The same mesh always gives the same bytes.
    """
    return _drawn(mesh, format, size, lambda *seen: _SURFACE)


def draw_painted(mesh: Mesh, format: str, size: int, points: Floats, colours: Floats) -> bytes:
    """The same picture, each place with the colour of the points near it.

    Parameters
    ----------
    mesh : Mesh
    format : str
        Of the file that it was read from, which says what is up.
    size : int
        Pixels a side.
    points : float64, shape (p, 3), p >= 1
        In the mesh's frame.
    colours : float64, shape (p, 3)
        Red, green and blue of each, in [0, 1].
    """

    def colour(seen: Ints, pixels: Floats, corners: Floats) -> Floats:
        places = np.einsum("pc,pcx->px", _shares(corners[seen], pixels), mesh.vertices[mesh.faces[seen]])
        return spread(points, colours, places)[:, :3].astype(np.float64)

    return _drawn(mesh, format, size, colour)


def _drawn(mesh: Mesh, format: str, size: int, colour: Callable[[Ints, Floats, Floats], Floats]) -> bytes:
    """The picture in colours of p pixels: by the triangle of each, by where it is, and by all corners."""
    middle, half = frame(mesh.vertices)
    seen_from = camera() @ upright(format)
    points = (mesh.vertices - middle) / half @ seen_from.T
    low, high = points.min(axis=0), points.max(axis=0)
    fine = size * _FINER
    # A margin of 4 % on each side.
    scale = 0.92 * fine / (float((high - low)[:2].max()) or 1.0)
    points = (points - 0.5 * (low + high)) * scale
    points[:, 0] += 0.5 * fine
    points[:, 1] = 0.5 * fine - points[:, 1]
    corners = points[mesh.faces]
    seen = nearest_triangles(corners, fine)
    hit = seen != NOTHING
    pixels = np.argwhere(hit)[:, ::-1].astype(np.float64) + 0.5
    colours = np.zeros((fine, fine, 4))
    colours[hit, :3] = _light(corners)[seen[hit], None] * colour(seen[hit], pixels, corners)
    colours[hit, 3] = 255.0
    return _png(_coarser(colours))


def _shares(corners: Floats, pixels: Floats) -> Floats:
    """Barycentric coordinates, shape (p, 3), of p pixels, each in a triangle of its own."""
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    across = pixels - corners[:, 0, :2]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    b = (across[:, 0] * sides[:, 1, 1] - across[:, 1] * sides[:, 1, 0]) / area
    c = (sides[:, 0, 0] * across[:, 1] - sides[:, 0, 1] * across[:, 0]) / area
    return np.stack([1.0 - b - c, b, c], axis=1)


def _light(corners: Floats) -> Floats:
    """How bright each triangle is, in [0, 1], from whichever side it is seen."""
    normals = face_normals(corners) * [1.0, -1.0, 1.0]
    # Whichever way its corners go round, the side that is seen faces the eye.
    normals *= np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    return np.asarray(0.40 + 0.60 * np.clip(normals @ _TOWARDS_LIGHT, 0.0, 1.0))


def _coarser(colours: Floats) -> Floats:
    """The mean of each block of pixels; what is seen counts for the colour, and all for the opacity."""
    size = len(colours) // _FINER
    blocks = colours.reshape(size, _FINER, size, _FINER, 4).sum(axis=(1, 3))
    opaque = blocks[..., 3:] / 255.0
    blocks[..., :3] /= np.maximum(opaque, 1.0)
    blocks[..., 3] /= _FINER**2
    return np.asarray(blocks)


def _png(colours: Floats) -> bytes:
    file = BytesIO()
    # Shades of one colour: a palette shows them as well, in a third of the bytes.
    picture = Image.fromarray(np.rint(colours).astype(np.uint8), "RGBA").quantize(
        256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    picture.save(file, "PNG", compress_level=9)
    return file.getvalue()
