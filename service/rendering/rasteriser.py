"""Rasterisation of triangles with a depth buffer."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.numerics.compilation import compiled

NOTHING = -1


def nearest_triangles(corners: Floats, size: int) -> NDArray[np.int64]:
    """The visible triangle of each pixel.

    Parameters
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of each triangle: x from the left and y from the top in pixels, and height towards the viewer.
        The centre of pixel (i, j) is at x = j + 0.5, y = i + 0.5.
    size : int
        Width and height in pixels.

    Returns
    -------
    int64, shape (size, size)
        The highest triangle at the pixel, the first one of equals; `NOTHING` where there is none.
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
            for j in range(left, right + 1):
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
