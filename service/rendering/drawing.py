"""Meshes drawn without a screen or OpenGL: shaded surfaces and coloured points in a grid."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from core.mesh.mesh import Mesh, face_normals

SURFACE = (0.80, 0.83, 0.87)
TOWARDS_LIGHT = np.array([0.35, -0.75, 0.56])
ELEVATION, AZIMUTH = 18.0, -62.0


@dataclass(frozen=True, eq=False)
class Panel:
    """One mesh of a picture.

    Attributes
    ----------
    mesh : Mesh
    caption : str
    points : float64, shape (p, 3)
        Points to mark, in the coordinates of the mesh.
    values : float64, shape (p,)
        Colour of each point, in [0, 1]. Corresponding points have the same value.
    colour : three floats in [0, 1]
        Colour of the surface.
    size : float
        Area of a mark in square points (1 / 72 inch).
    painted : float64, shape (n, 3) or (0, 3)
        Vertex colours in [0, 1], which replace `colour`.
    """

    mesh: Mesh
    caption: str
    points: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    values: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    colour: tuple[float, float, float] = SURFACE
    size: float = 11.0
    painted: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))


def _shade(panel: Panel) -> NDArray[np.float64]:
    mesh = panel.mesh
    normals = face_normals(mesh.vertices[mesh.faces])
    light = 0.45 + 0.55 * np.clip(normals @ TOWARDS_LIGHT, 0.0, 1.0)
    colours = panel.painted[mesh.faces].mean(axis=1) if len(panel.painted) else np.array([panel.colour])
    return np.asarray(light[:, None] * colours)


def draw_panel(axes: Axes3D, panel: Panel) -> None:
    """Draw a panel on three-dimensional axes."""
    low, high = panel.mesh.vertices.min(axis=0), panel.mesh.vertices.max(axis=0)
    middle, half = 0.5 * (low + high), 0.36 * float(np.linalg.norm(high - low))
    corners = (panel.mesh.vertices[panel.mesh.faces] - middle) / half
    faded = 0.55 if len(panel.points) else 1.0
    axes.add_collection3d(Poly3DCollection(list(corners), facecolors=_shade(panel), alpha=faded))
    if len(panel.points):
        x, y, z = ((panel.points - middle) / half).T
        colours = colormaps["hsv"](panel.values)
        axes.scatter(x, y, z, c=colours, s=panel.size, depthshade=False, edgecolors="black", linewidths=0.25)
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    axes.set_box_aspect((1, 1, 1), zoom=1.35)
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    axes.set_axis_off()
    axes.set_title(panel.caption, fontsize=8, y=-0.06)


def draw_grid(rows: Sequence[Sequence[Panel]], *, dpi: int = 90, size: float = 2.3) -> bytes:
    """Return a PNG with a grid of panels of `size` inches each; equal panels give equal bytes."""
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(size * columns, size * len(rows)), layout="tight")
    FigureCanvasAgg(figure)
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            draw_panel(figure.add_subplot(len(rows), columns, i * columns + j + 1, projection="3d"), panel)
    return png(figure, dpi=dpi)


def png(figure: Figure, *, dpi: int = 90) -> bytes:
    """Return the figure as a PNG without Matplotlib's version: equal pictures have equal bytes."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})
    return file.getvalue()
