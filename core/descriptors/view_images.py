"""Images of a surface along the axes of a frame, from both sides, without perspective: depth and shading."""

import numpy as np

from core.arrays import Float32s, Floats, Ints
from core.numerics.compilation import compiled_for_reading

FILLED = 0.86
"""Share of the image's width that the surface fills along its longer side."""

NEAREST, FARTHEST, EMPTY = 0.7, 0.1, 1.0
"""Brightness of the nearest and of the farthest point of an image, and of the background."""

LIGHT = np.radians(20.0)
"""Angle between the view and the light, which comes from the first rows of an image."""

DARKEST, BRIGHTEST = 0.1, 0.85
"""Brightness of a surface that is turned from the light, and of one that faces it."""

FLAT = 1e-3
"""Depths of a smaller range, over the surface's longer side, do not fill the range of brightness: between the
points of a flat face they are those of rounding."""


def view_images(points: Floats, faces: Ints, axes: Floats, size: int) -> Float32s:
    """Return images along each axis and against it, shape (6, 3, size, size), in [0, 1].

    The channels are the depth, its mean with the shading (Lambert), and the shading: a network that was
    trained on colours sees more in three different channels than in three equal ones.

    Parameters
    ----------
    points : float64, shape (n, 3)
    faces : int64, shape (f, 3)
        Triangles of either orientation.
    axes : float64, shape (3, 3)
        Rows are orthonormal.
    size : int
        Width and height in pixels.
    """
    images = np.full((6, 3, size, size), EMPTY, dtype=np.float32)
    turned = points @ axes.T
    for axis in range(3):
        seen = turned[:, [(axis + 1) % 3, (axis + 2) % 3, axis]]
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = FILLED * size / max(float((high - low)[:2].max()), float(np.finfo(np.float64).tiny))
        seen = (seen - 0.5 * (low + high)) * scale
        seen[:, :2] += 0.5 * size
        near, far = _depths(seen, faces, size)
        for side, depths in enumerate((near, -far)):
            covered = np.isfinite(depths)
            if covered.any():
                most, least = depths[covered].max(), depths[covered].min()
                share = (depths - least) / max(most - least, FLAT * FILLED * size)
                depth = FARTHEST + (NEAREST - FARTHEST) * share
                shading = DARKEST + (BRIGHTEST - DARKEST) * _lit(depths)
                image = np.where(covered, [depth, 0.5 * (depth + shading), shading], EMPTY)
                images[2 * axis + side] = image[..., ::-1] if side else image
    return images


@compiled_for_reading
def _lit(depths: Floats) -> Floats:
    """Return the cosine of each pixel's normal with the light, at least 0; 0 where the depth is infinite."""
    lit = np.zeros_like(depths)
    for row in range(len(depths)):
        for column in range(depths.shape[1]):
            z = depths[row, column]
            if not np.isfinite(z):
                continue
            # Means of the differences with both neighbours, or that with the only one.
            slopes = np.zeros(2)
            for axis in range(2):
                count = 0
                for step in (-1, 1):
                    r, c = (row + step, column) if axis == 0 else (row, column + step)
                    if 0 <= r < len(depths) and 0 <= c < depths.shape[1] and np.isfinite(depths[r, c]):
                        slopes[axis] += step * (depths[r, c] - z)
                        count += 1
                slopes[axis] /= max(count, 1)
            down, across = slopes
            towards = np.cos(LIGHT) + np.sin(LIGHT) * down
            lit[row, column] = max(towards, 0.0) / np.sqrt(1.0 + down * down + across * across)
    return lit


@compiled_for_reading
def _depths(corners: Floats, faces: Ints, size: int) -> tuple[Floats, Floats]:
    """Return the largest and the least z at each pixel's centre, shape (size, size); infinite if empty."""
    near = np.full((size, size), -np.inf)
    far = np.full((size, size), np.inf)
    for f in range(len(faces)):
        ax, ay, az = corners[faces[f, 0], 0], corners[faces[f, 0], 1], corners[faces[f, 0], 2]
        bx, by, bz = corners[faces[f, 1], 0], corners[faces[f, 1], 1], corners[faces[f, 1], 2]
        cx, cy, cz = corners[faces[f, 2], 0], corners[faces[f, 2], 1], corners[faces[f, 2], 2]
        # Pixel (row, column) has its centre at (column + 1/2, row + 1/2).
        top, bottom = max(int(np.ceil(min(ay, by, cy) - 0.5)), 0), min(int(max(ay, by, cy) - 0.5), size - 1)
        left, right = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0), min(int(max(ax, bx, cx) - 0.5), size - 1)
        twice = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if twice == 0.0:
            continue
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / twice
                c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / twice
                if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
                    z = az + b * (bz - az) + c * (cz - az)
                    near[row, column] = max(near[row, column], z)
                    far[row, column] = min(far[row, column], z)
    return near, far
