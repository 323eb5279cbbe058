"""Thumbnails of meshes in one colour, or coloured by points."""

from collections.abc import Callable
from io import BytesIO

import numpy as np
from PIL import Image

from core.arrays import Floats, Ints
from core.mesh.face_normals import face_normals
from core.mesh.mesh import Mesh
from service.rendering.colours import interpolate_colours
from service.rendering.rasteriser import NOTHING, nearest_triangles
from service.rendering.viewpoint import camera, frame, upright

SIZES = (64, 128, 256, 512)

# Version of the renderer. Stored thumbnails of other versions are drawn again.
DRAWING = 1

_SURFACE = np.array([126.0, 158.0, 201.0])
_TOWARDS_LIGHT = np.array([-0.35, 0.62, 0.70])
_OVERSAMPLING = 2


def draw(mesh: Mesh, format: str, size: int) -> bytes:
    """A PNG of `size` by `size` pixels: the mesh, lit from the upper left, on a transparent background.

    The same mesh always gives the same bytes.
    """
    return _rendered(mesh, format, size, lambda *seen: _SURFACE)


def draw_painted(mesh: Mesh, format: str, size: int, points: Floats, colours: Floats) -> bytes:
    """The same picture, with the surface coloured by interpolation between points.

    Parameters
    ----------
    mesh : Mesh
    format : str
        Format of the mesh's file, which determines the upward axis.
    size : int
        Width and height in pixels.
    points : float64, shape (p, 3), p >= 1
        In the coordinates of the mesh.
    colours : float64, shape (p, 3)
        Red, green and blue of each point, in [0, 1].
    """

    def colour(seen: Ints, pixels: Floats, corners: Floats) -> Floats:
        weights = _barycentric(corners[seen], pixels)
        positions = np.einsum("pc,pcx->px", weights, mesh.vertices[mesh.faces[seen]])
        return interpolate_colours(points, colours, positions)[:, :3].astype(np.float64)

    return _rendered(mesh, format, size, colour)


def _rendered(mesh: Mesh, format: str, size: int, colour: Callable[[Ints, Floats, Floats], Floats]) -> bytes:
    """Render a mesh; `colour` gives the colours of pixels from triangles, positions and all corners."""
    middle, half = frame(mesh.vertices)
    seen_from = camera() @ upright(format)
    points = (mesh.vertices - middle) / half @ seen_from.T
    low, high = points.min(axis=0), points.max(axis=0)
    fine = size * _OVERSAMPLING
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
    colours[hit, :3] = _brightness(corners)[seen[hit], None] * colour(seen[hit], pixels, corners)
    colours[hit, 3] = 255.0
    return _png(_downsampled(colours))


def _barycentric(corners: Floats, pixels: Floats) -> Floats:
    """Barycentric coordinates, shape (p, 3), of p pixels in p triangles."""
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    across = pixels - corners[:, 0, :2]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    b = (across[:, 0] * sides[:, 1, 1] - across[:, 1] * sides[:, 1, 0]) / area
    c = (sides[:, 0, 0] * across[:, 1] - sides[:, 0, 1] * across[:, 0]) / area
    return np.stack([1.0 - b - c, b, c], axis=1)


def _brightness(corners: Floats) -> Floats:
    """The brightness of each triangle in [0, 1], equal for both of its sides."""
    normals = face_normals(corners) * [1.0, -1.0, 1.0]
    # The visible side faces the viewer, whatever the order of the corners.
    normals *= np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    return np.asarray(0.40 + 0.60 * np.clip(normals @ _TOWARDS_LIGHT, 0.0, 1.0))


def _downsampled(colours: Floats) -> Floats:
    """Average blocks of pixels: the colour over visible pixels, the opacity over all."""
    size = len(colours) // _OVERSAMPLING
    blocks = colours.reshape(size, _OVERSAMPLING, size, _OVERSAMPLING, 4).sum(axis=(1, 3))
    opaque = blocks[..., 3:] / 255.0
    blocks[..., :3] /= np.maximum(opaque, 1.0)
    blocks[..., 3] /= _OVERSAMPLING**2
    return np.asarray(blocks)


def _png(colours: Floats) -> bytes:
    file = BytesIO()
    # A palette holds the shades of one colour without visible loss, in a third of the bytes.
    picture = Image.fromarray(np.rint(colours).astype(np.uint8), "RGBA").quantize(
        256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    picture.save(file, "PNG", compress_level=9)
    return file.getvalue()
