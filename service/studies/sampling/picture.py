"""A faint view of a mesh along the z axis of its normal frame, with points on the visible side."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh, face_normals

_CHUNK = 128
"""Vertices whose visibility is computed at a time."""

_GREYS = 6
"""Grey levels: enough to show the form, few enough for a small file."""


@dataclass(frozen=True, eq=False)
class Picture:
    """One view of a mesh, prepared once and drawn often.

    Attributes
    ----------
    places : float64, shape (n, 2)
        Positions of the vertices in the picture, with the longest axis upright.
    faces : float64, shape (f, 3, 2)
        Triangles that face the viewer, in descending distance.
    shades : float64, shape (f,)
        Brightness of the triangles, 0 to 1.
    visible : bool, shape (n,)
        Whether no triangle covers the vertex.
    """

    places: Floats
    faces: Floats
    shades: Floats
    visible: NDArray[np.bool_]

    @classmethod
    def of(cls, mesh: Mesh) -> "Picture":
        """The view of a mesh in its normal frame, from the end of z."""
        x, y, depth = mesh.vertices.T
        # The x axis of the normal frame points to the thin end, which is usually the foot.
        places = np.stack([y, -x], axis=1)
        corners = np.column_stack([places, depth])[mesh.faces]
        tilt = np.abs(face_normals(corners)[:, 2])
        order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
        return cls(
            places=places,
            faces=corners[order, :, :2],
            shades=0.78 + 0.17 * np.rint(_GREYS * tilt[order]) / _GREYS,
            visible=_visible(np.column_stack([places, depth]), corners),
        )

    def draw(self, axes: Axes, samples: Ints, *, size: float, values: Floats | None = None) -> None:
        """Draw the mesh and its visible samples, in black or by values in [0, 1], shape (n,)."""
        greys = np.repeat(self.shades[:, None], 3, axis=1)
        axes.add_collection(
            PolyCollection(list(self.faces), facecolors=greys, edgecolors=greys, linewidths=0.2)
        )
        seen = samples[self.visible[samples]]
        x, y = self.places[seen].T
        if values is None:
            axes.scatter(x, y, s=size, color="black", linewidths=0, zorder=2)
        else:
            shown = values[seen]
            axes.scatter(x, y, s=size, c=shown, cmap="viridis_r", vmin=0, vmax=1, linewidths=0, zorder=2)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set_axis_off()


def _visible(points: Floats, corners: Floats) -> NDArray[np.bool_]:
    """Whether each point, shape (n, 3), is visible along the third axis: no triangle covers it."""
    a, b, c = (corners[:, i, :2] for i in range(3))
    double = _cross(b - a, c - a)
    upright = np.abs(double) > 1e-12
    a, b, c, double, heights = a[upright], b[upright], c[upright], double[upright], corners[upright, :, 2]
    seen = np.ones(len(points), dtype=bool)
    near = 1e-6 * float(np.ptp(points[:, 2]) or 1.0)
    for start in range(0, len(points), _CHUNK):
        part = points[start : start + _CHUNK, None, :]
        place = part[:, :, :2]
        u = _cross(c - b, place - b) / double
        v = _cross(a - c, place - c) / double
        w = 1.0 - u - v
        inside = (u > 0.0) & (v > 0.0) & (w > 0.0)
        above = u * heights[:, 0] + v * heights[:, 1] + w * heights[:, 2] > part[:, :, 2] + near
        seen[start : start + _CHUNK] = ~(inside & above).any(axis=1)
    return seen


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
