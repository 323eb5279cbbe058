"""Panoramas: a surface projected onto the cylinders about the three axes of a frame.

P. Papadakis, I. Pratikakis, T. Theoharis, S. Perantonis, "PANORAMA", International Journal of Computer Vision
89, 2010. Each panorama is expanded in a Fourier series around the axis and a cosine transform along it. A
reflection of the frame changes only signs of these coefficients, so their magnitudes describe the shape and
its mirror image alike, in any choice of the axes' signs.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.numerics.compilation import compiled, compiled_for_reading

AZIMUTHS, HEIGHTS = 64, 33
"""Cells of a panorama around the axis and along it. The planes of the frame go through the middle of cells:
rounding does not move a flat surface in such a plane from one cell to the next."""

HALF_HEIGHT = 1.8
"""Half the height of the cylinder, in root mean square radii. The last cell holds all points beyond."""

_BORDERS = np.tan(np.arange(1, AZIMUTHS // 4, 2) * (np.pi / AZIMUTHS))
"""Slopes of the borders between cells, in an eighth of the circle."""

CHANNELS = 2
"""Panoramas about one axis: the radius of the outermost point; the magnitude of the cosine between its normal
and the radius."""

LEAST = 1e-3
"""Least sum by which magnitudes are divided: a panorama that is 0 but for rounding stays so."""

AROUND, ALONG = 8, 12
"""Highest frequencies around the axis (per turn) and along it (half waves in the height)."""


def panoramas(points: Floats, normals: Floats, axes: Floats) -> Floats:
    """Return panoramas about three axes, shape (3, CHANNELS, AZIMUTHS, HEIGHTS), >= 0; 0 where empty.

    Parameters
    ----------
    points : float64, shape (p, 3)
        Sample points, evenly spread by area, at a root mean square radius of 1.
    normals : float64, shape (p, 3)
        Unit normals at the points, of either sign.
    axes : float64, shape (3, 3)
        Rows are orthonormal.
    """
    return _panoramas(points @ axes.T, normals @ axes.T)


def magnitudes(maps: Floats) -> Floats:
    """Return magnitudes of low frequencies, shape (..., `kept().sum()`), of sum 1 for each panorama.

    Panoramas, shape (..., AZIMUTHS, HEIGHTS), are >= 0; the sum is 0 for one without a value.
    """
    around, along = _waves()
    kept_magnitudes = np.abs(around @ maps @ along.T)[..., kept()]
    return np.asarray(kept_magnitudes / np.maximum(kept_magnitudes.sum(axis=-1, keepdims=True), LEAST))


@cache
def kept() -> NDArray[np.bool_]:
    """Return the mask of the frequencies inside an ellipse, shape (2 AROUND + 1, ALONG + 1)."""
    return frequency_radii() <= 1.0


def frequency_radii() -> Floats:
    """Return norms of the frequencies, shape (2 AROUND + 1, ALONG + 1); 0 at the mean, 1 on the ellipse."""
    around = (np.arange(1, 2 * AROUND + 2) // 2)[:, None] / (AROUND + 0.5)
    return np.hypot(around, np.arange(ALONG + 1) / (ALONG + 0.5))


@cache
def _waves() -> tuple[Floats, Floats]:
    """Return waves around the axis, (2 AROUND + 1, AZIMUTHS), and along it, (ALONG + 1, HEIGHTS)."""
    angles = np.arange(AZIMUTHS) * (2.0 * np.pi / AZIMUTHS)
    turns = [wave(k * angles) for k in range(1, AROUND + 1) for wave in (np.cos, np.sin)]
    heights = (np.arange(HEIGHTS) + 0.5) * (np.pi / HEIGHTS)
    flat = np.sqrt(0.5)
    along = np.cos(np.arange(ALONG + 1)[:, None] * heights)
    along[0] = flat
    return np.stack([np.full(AZIMUTHS, flat), *turns]), along


@compiled
def _azimuth(x: float, y: float) -> int:
    """Return the cell of the direction (x, y); cell 0 has the direction (1, 0) in its middle."""
    low, high = min(abs(x), abs(y)), max(abs(x), abs(y))
    cell = 0
    for border in _BORDERS:
        cell += low > border * high
    cell = cell if abs(y) <= abs(x) else AZIMUTHS // 4 - cell
    cell = cell if x >= 0.0 else AZIMUTHS // 2 - cell
    return cell if y >= 0.0 or cell == 0 else AZIMUTHS - cell


@compiled_for_reading
def _panoramas(points: Floats, normals: Floats) -> Floats:
    """Return panoramas about the three coordinate axes: see `panoramas`."""
    maps = np.zeros((3, CHANNELS, AZIMUTHS, HEIGHTS))
    for axis in range(3):
        east, north = (axis + 1) % 3, (axis + 2) % 3
        for p in range(len(points)):
            x, y = points[p, east], points[p, north]
            # The cell of the cylinder, and in it the outermost point with its normal.
            radius = np.sqrt(x * x + y * y)
            i = _azimuth(x, y)
            row = int((points[p, axis] / HALF_HEIGHT + 1.0) * (0.5 * HEIGHTS))
            j = min(max(row, 0), HEIGHTS - 1)
            if radius > maps[axis, 0, i, j]:
                maps[axis, 0, i, j] = radius
                maps[axis, 1, i, j] = abs(normals[p, east] * x + normals[p, north] * y) / radius
    return maps
