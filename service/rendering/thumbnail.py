"""Pictures of meshes: the view, the rasteriser, thumbnails in one colour or coloured by points."""

from collections.abc import Callable, Sequence
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.arrays import Floats, Ints
from core.io import FORMATS
from core.mesh.mesh import Mesh, face_normals
from core.numerics.compilation import compiled
from service.rendering.colours import interpolate_colours

# The initial view in degrees, as on the page.
ELEVATION, AZIMUTH = 18.0, 28.0

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def upright(format: str) -> Floats:
    """Return the rotation matrix, shape (3, 3), that turns the upward axis of a format to y."""
    return np.eye(3) if FORMATS[format].y_up else _Z_UP


def camera() -> Floats:
    """Return the camera's axes as rows, shape (3, 3): right, up and towards the viewer, where y is up."""
    elevation, azimuth = np.radians([ELEVATION, AZIMUTH])
    towards = np.array(
        [np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)]
    )
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    return np.stack([right, np.cross(towards, right), towards])


def frame(vertices: Floats) -> tuple[NDArray[np.float64], float]:
    """Return the centre of the points' bounding box, shape (3,), and half its longest edge, or 1."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = float((0.5 * high - 0.5 * low).max())
    return 0.5 * low + 0.5 * high, half or 1.0


NOTHING = -1
WIDE = 4
"""Widest box of a triangle, in pixels, of which every pixel is tried."""


def nearest_triangles(corners: Floats, size: int) -> NDArray[np.int64]:
    """Return the visible triangle of each pixel, the first one of equals, shape (size, size); else `NOTHING`.

    The corners of each triangle, shape (f, 3, 3), have x from the left and y from the top in pixels, and
    height towards the viewer. The centre of pixel (i, j) is at x = j + 0.5, y = i + 0.5.
    """
    seen = np.full((size, size), NOTHING, dtype=np.int64)
    _fill(np.ascontiguousarray(corners, dtype=np.float64), np.full((size, size), -np.inf), seen)
    return seen


@compiled
def _fill(corners: Floats, height: Floats, seen: NDArray[np.int64]) -> None:
    size = seen.shape[0]
    for f in range(len(corners)):
        ax, ay, az = corners[f, 0]
        bx, by, bz = corners[f, 1]
        cx, cy, cz = corners[f, 2]
        twice_area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if twice_area == 0.0:
            continue
        left = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        right = min(size - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        top = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        bottom = min(size - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        for i in range(top, bottom + 1):
            y = i + 0.5
            first, last = left, right
            if right - left > WIDE:
                # A needle is far thinner than its box: the row between its sides, and a pixel more.
                low, high = np.inf, -np.inf
                for side in range(3):
                    px, py, _ = corners[f, side]
                    qx, qy, _ = corners[f, (side + 1) % 3]
                    if min(py, qy) <= y <= max(py, qy):
                        start, end = (0.0, 1.0) if py == qy else ((y - py) / (qy - py), (y - py) / (qy - py))
                        low = min(low, px + start * (qx - px), px + end * (qx - px))
                        high = max(high, px + start * (qx - px), px + end * (qx - px))
                if low <= high:
                    first = max(left, int(np.floor(low - 0.5)) - 1)
                    last = min(right, int(np.ceil(high - 0.5)) + 1)
            for j in range(first, last + 1):
                x = j + 0.5
                # Barycentric coordinates of the pixel, for either orientation of the triangle.
                a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / twice_area
                b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / twice_area
                c = 1.0 - a - b
                if a >= 0.0 and b >= 0.0 and c >= 0.0:
                    z = a * az + b * bz + c * cz
                    if z > height[i, j]:
                        height[i, j] = z
                        seen[i, j] = f


SIZES = (64, 128, 256, 512)

# Version of the renderer. Stored thumbnails of other versions are drawn again.
DRAWING = 1

_SURFACE = np.array([126.0, 158.0, 201.0])
_TOWARDS_LIGHT = np.array([-0.35, 0.62, 0.70])
_OVERSAMPLING = 2


def draw(mesh: Mesh, format: str, size: int) -> bytes:
    """Draw a PNG of `size` by `size` pixels: the mesh, lit from the upper left, on a transparent ground.

    The same mesh always gives the same bytes.
    """
    return _rendered(mesh, format, size, lambda *seen: _SURFACE)


def draw_painted(mesh: Mesh, format: str, size: int, points: Floats, colours: Floats) -> bytes:
    """Return the same picture, with the surface coloured by interpolation between p >= 1 points.

    The points, shape (p, 3), are in the coordinates of the mesh; their colours, shape (p, 3), are red, green
    and blue in [0, 1].
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
    picture = Image.fromarray(np.rint(_downsampled(colours)).astype(np.uint8), "RGBA")
    return _png(picture, compress_level=9)


def _barycentric(corners: Floats, pixels: Floats) -> Floats:
    """Return barycentric coordinates, shape (p, 3), of p pixels in p triangles."""
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    across = pixels - corners[:, 0, :2]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    b = (across[:, 0] * sides[:, 1, 1] - across[:, 1] * sides[:, 1, 0]) / area
    c = (sides[:, 0, 0] * across[:, 1] - sides[:, 0, 1] * across[:, 0]) / area
    return np.stack([1.0 - b - c, b, c], axis=1)


def _brightness(corners: Floats) -> Floats:
    """Return the brightness of each triangle in [0, 1], equal for both of its sides."""
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


def contact_sheet(pictures: Sequence[bytes | None], columns: int, side: int) -> bytes:
    """Return one PNG of square pictures, `side` pixels wide, row by row in as many rows as columns.

    The cell of a missing picture is transparent; without columns the sheet is one such pixel.
    """
    sheet = Image.new("RGBA", (columns * side or 1, columns * side or 1))
    for i, picture in enumerate(pictures):
        if picture is not None:
            row, column = divmod(i, columns)
            sheet.paste(Image.open(BytesIO(picture)).convert("RGBA"), (column * side, row * side))
    return _png(sheet, compress_level=6)


def _png(picture: Image.Image, compress_level: int) -> bytes:
    file = BytesIO()
    # A palette holds the shades of one colour without visible loss, in a third of the bytes.
    picture.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        file, "PNG", compress_level=compress_level
    )
    return file.getvalue()
