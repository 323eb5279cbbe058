"""From parts to a triangle mesh: grid of distances, isosurface, relaxation to even triangles, decimation.

`genus` checks the topology of the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array

from core.arrays import Floats, Ints
from core.gallery.marching_cubes import marching_cubes
from core.gallery.solids import Field, Part
from core.mesh.edges import component_labels
from core.mesh.mesh import face_normals

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

_SURPLUS = 2.0
"""Vertices of the isosurface over the wanted number; decimation removes the surplus."""

_LEAST_COSINE = 0.3
"""Least cosine between a face's normals before and after a relaxation step; it prevents folds."""


def smooth_minimum(first: Floats, second: Floats, blend: float) -> Floats:
    """Return min(a, b) - h^2 k / 4 with h = max(1 - |a - b| / k, 0), where k is `blend` >= 0."""
    least = np.minimum(first, second)
    if blend == 0.0:
        return least
    overlap = np.maximum(blend - np.abs(first - second), 0.0) / blend
    return least - 0.25 * blend * overlap**2


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
        """Return the grid of the parts joined in their order, with a border of cells that lie outside."""
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
        joined = np.full(self.values[window].shape, _FAR)
        for field in part.fields:
            inner = self._window(field.low, field.high, reach)
            axes = [self.low[i] + self.cell * np.arange(inner[i].start, inner[i].stop) for i in range(3)]
            points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            distance = field.distance(points.reshape(-1, 3)).reshape(points.shape[:3])
            local = tuple(
                slice(a.start - b.start, a.stop - b.start) for a, b in zip(inner, window, strict=True)
            )
            np.minimum(joined[local], distance, out=joined[local])
        self.values[window] = smooth_minimum(self.values[window].astype(np.float64), joined, part.blend)

    def _window(self, low: Floats, high: Floats, reach: float) -> tuple[slice, ...]:
        first = np.maximum(np.floor((low - reach - self.low) / self.cell).astype(int), 0)
        last = np.minimum(np.ceil((high + reach - self.low) / self.cell).astype(int) + 1, self.values.shape)
        return tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))

    def isosurface(self) -> tuple[Floats, Ints]:
        """Return the vertices, shape (n, 3), and outward faces, shape (f, 3), of marching cubes at zero."""
        snap = np.float32(_SNAP * self.cell)
        values = np.where(np.abs(self.values) < snap, np.copysign(snap, self.values), self.values)
        vertices, faces = marching_cubes(values)
        return vertices * self.cell + self.low, faces

    def projected(self, points: Floats) -> Floats:
        """Return points near the surface, shape (n, 3), after one Newton step towards it, at most a cell."""
        steps = self.cell * np.eye(3)
        rises = [self._at(points + step) - self._at(points - step) for step in steps]
        gradient = np.stack(rises, axis=1) / (2.0 * self.cell)
        slope = np.maximum(np.einsum("ij,ij->i", gradient, gradient), _LEAST_SLOPE**2)
        step = self._at(points)[:, None] * gradient / slope[:, None]
        length = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), self.cell)
        nearer: Floats = points - step * (self.cell / length)
        return nearer

    def _at(self, points: Floats) -> Floats:
        indices = ((points - self.low) / self.cell).T
        distances: Floats = map_coordinates(self.values, indices, output=np.float64, order=1, mode="nearest")
        return distances


def surface(parts: Sequence[Part], vertices: int) -> tuple[Floats, Ints]:
    """Return vertices, about as many as wanted, and faces of the parts blended in their order.

    Faces are counter-clockwise seen from outside. Rarely, the decimation leaves an edge with more than two
    faces.
    """
    # Cells that resolve the thinnest field, within the limit on their number.
    fields = [field for part in parts for field in part.fields]
    low, high = _box(fields)
    thinnest = min(field.thickness for field in fields)
    cell = max(thinnest / _CELLS_ACROSS, float(np.cbrt(np.prod(high - low) / _MOST_CELLS)))
    grid = Grid.of(parts, cell)
    points, faces = grid.isosurface()
    if len(points) < _SURPLUS * vertices:
        # The number of vertices goes with the inverse square of the cell; aim five per cent above the least.
        grid = Grid.of(parts, cell * float(np.sqrt(len(points) / (1.05 * _SURPLUS * vertices))))
        points, faces = grid.isosurface()
    points = _relaxed(grid, points, faces, rounds=5)
    points, faces = fast_simplification.simplify(points, faces, target_count=2 * vertices)
    points, faces = points.astype(np.float64), faces.astype(np.int64)
    return _relaxed(grid, points, faces, rounds=2), faces


def _relaxed(grid: Grid, points: Floats, faces: Ints, rounds: int) -> Floats:
    """Move vertices to the mean of their neighbours and project them to the surface; this removes slivers."""
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(len(points),) * 2).tocsr()
    degree = graph.sum(axis=1)[:, None]
    for _ in range(rounds):
        moved = grid.projected(points + 0.5 * (graph @ points / degree - points))
        before = face_normals(points[faces])
        for _ in range(2):
            folded = np.einsum("ij,ij->i", before, face_normals(moved[faces])) < _LEAST_COSINE
            corners = np.unique(faces[folded])
            moved[corners] = points[corners]
        points = moved
    return points


def genus(faces: Ints) -> int | None:
    """Return the number of handles of a closed, connected and oriented manifold, None for any other surface.

    Every edge joins two triangles that agree in direction, and the triangles at each vertex are one fan. The
    genus is then (2 - (V - E + F)) / 2, where E = 3 F / 2.
    """
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    forward, backward = tails * len(used) + heads, heads * len(used) + tails
    order, twins = np.argsort(forward), np.argsort(backward)
    paired = np.array_equal(forward[order], backward[twins]) and not (tails == heads).any()
    if not paired or len(np.unique(forward)) < len(forward):
        return None
    # A half-edge leaves a corner; the twin of the half-edge arrives there from the next triangle of the fan.
    arriving = np.empty_like(order)
    arriving[twins] = order
    following = arriving - arriving % 3 + (arriving + 1) % 3
    fans, _ = component_labels(len(tails), np.stack([np.arange(len(tails)), following], axis=1))
    if fans != len(used) or component_labels(len(used), faces)[0] != 1:
        return None
    return (2 - len(used) + len(faces) // 2) // 2
