"""The distance field of blended parts on a cubic grid, and its isosurface at zero."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from skimage.measure import marching_cubes

from core.arrays import Floats, Ints
from core.gallery.fields import Field
from core.gallery.parts import Part

_FAR = 1e3
"""A distance larger than any shape; finite, so that differences are defined."""

_MOST_CELLS = 1_200_000
"""Bounds time and memory; the shapes here need 20 thousand to a million cells."""

_CELLS_ACROSS = 3.0
"""Number of cells across the thinnest field; below two the isosurface has gaps."""

_SNAP = 0.08
"""Least magnitude of a grid value, in cells; it keeps vertices away from the corners of the grid."""

_LEAST_SLOPE = 0.5
"""Least slope for a Newton step. A distance has slope 1, and less where surfaces meet, where the step would
be too long."""


def smooth_minimum(first: Floats, second: Floats, blend: float) -> Floats:
    """Quadratic smooth minimum: min(a, b) - h^2 k / 4 with h = max(1 - |a - b| / k, 0), k = `blend` >= 0."""
    least = np.minimum(first, second)
    if blend == 0.0:
        return least
    overlap = np.maximum(blend - np.abs(first - second), 0.0) / blend
    return least - 0.25 * blend * overlap**2


def cell_size(parts: Sequence[Part]) -> float:
    """Edge of a cell that resolves the thinnest field, within the limit on their number."""
    low, high = _box([field for part in parts for field in part.fields])
    thinnest = min(field.thickness for part in parts for field in part.fields)
    return max(thinnest / _CELLS_ACROSS, float(np.cbrt(np.prod(high - low) / _MOST_CELLS)))


def _box(fields: Sequence[Field]) -> tuple[Floats, Floats]:
    return np.min([field.low for field in fields], axis=0), np.max([field.high for field in fields], axis=0)


@dataclass(frozen=True, eq=False)
class Grid:
    """Distances, `values`, at the corners of cells of edge `cell`; the first is at `low`, shape (3,)."""

    low: Floats
    cell: float
    values: NDArray[np.float32]

    @classmethod
    def of(cls, parts: Sequence[Part], cell: float) -> "Grid":
        """The parts joined in their order, with a border of cells that lie outside."""
        low, high = _box([field for part in parts for field in part.fields])
        # The smooth minimum lets the surface bulge out of the union by up to a quarter of the blend.
        border = 0.25 * max(part.blend for part in parts) + 2.5 * cell
        low = low - border
        shape = np.ceil((high + border - low) / cell).astype(int) + 1
        grid = cls(low, cell, np.full(tuple(shape), _FAR, dtype=np.float32))
        for part in parts:
            grid._join(part)
        return grid

    def _join(self, part: Part) -> None:
        """Join one part, evaluating each field only where it can move the surface."""
        reach = part.blend + 2.0 * self.cell
        window = self._window(*_box(part.fields), reach)
        own = np.full(self.values[window].shape, _FAR)
        for field in part.fields:
            inner = self._window(field.low, field.high, reach)
            axes = [self.low[i] + self.cell * np.arange(inner[i].start, inner[i].stop) for i in range(3)]
            points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            distance = field.distance(points.reshape(-1, 3)).reshape(points.shape[:3])
            local = tuple(
                slice(a.start - b.start, a.stop - b.start) for a, b in zip(inner, window, strict=True)
            )
            np.minimum(own[local], distance, out=own[local])
        self.values[window] = smooth_minimum(self.values[window].astype(np.float64), own, part.blend)

    def _window(self, low: Floats, high: Floats, reach: float) -> tuple[slice, ...]:
        first = np.maximum(np.floor((low - reach - self.low) / self.cell).astype(int), 0)
        last = np.minimum(np.ceil((high + reach - self.low) / self.cell).astype(int) + 1, self.values.shape)
        return tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))

    def isosurface(self) -> tuple[Floats, Ints]:
        """Marching cubes at zero: vertices, shape (n, 3), and outward faces, shape (f, 3)."""
        snap = np.float32(_SNAP * self.cell)
        values = np.where(np.abs(self.values) < snap, np.copysign(snap, self.values), self.values)
        # "descent": the values fall towards the inside.
        found = marching_cubes(values, 0.0, gradient_direction="descent")  # type: ignore[no-untyped-call]
        return found[0].astype(np.float64) * self.cell + self.low, found[1].astype(np.int64)

    def projected(self, points: Floats) -> Floats:
        """Points near the surface, shape (n, 3), after one Newton step towards it of at most a cell."""
        steps = self.cell * np.eye(3)
        rises = [self._at(points + step) - self._at(points - step) for step in steps]
        gradient = np.stack(rises, axis=1) / (2.0 * self.cell)
        slope = np.maximum(np.einsum("ij,ij->i", gradient, gradient), _LEAST_SLOPE**2)
        step = self._at(points)[:, None] * gradient / slope[:, None]
        length = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), self.cell)
        nearer: Floats = points - step * (self.cell / length)
        return nearer

    def _at(self, points: Floats) -> Floats:
        places = ((points - self.low) / self.cell).T
        distances: Floats = map_coordinates(self.values, places, output=np.float64, order=1, mode="nearest")
        return distances
