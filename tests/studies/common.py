"""Helpers that the scripts share: command line, CSV files and tables, pictures of meshes by matplotlib."""

import argparse
import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from core.arrays import Floats
from core.mesh.mesh import Mesh, face_normals

SURFACE = (0.80, 0.83, 0.87)
TOWARDS_LIGHT = np.array([0.35, -0.75, 0.56])
ELEVATION, AZIMUTH = 18.0, -62.0

Row = Mapping[str, Any]


def run(main: Callable[..., bool | None], doc: str, **options: Any) -> None:
    """Call `main(folder, **options)` with the options of the command line, and exit with status 1 on False.

    `doc` is the docstring of the script. `options` are the default of each option, or its type where there is
    none; "folders" is for one or more collections without a flag.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="where the CSV files and pictures go")
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        match value:
            case "folders":
                parser.add_argument(name, metavar="COLLECTION", type=Path, nargs="+")
            case bool():
                parser.add_argument(flag, action=argparse.BooleanOptionalAction, default=value)
            case list() | tuple():
                parser.add_argument(flag, type=type(value[0]), nargs="+", default=list(value))
            case type():
                parser.add_argument(flag, type=value)
            case _:
                parser.add_argument(flag, type=type(value), default=value)
    given = vars(parser.parse_args())
    given["folder"].mkdir(parents=True, exist_ok=True)
    sys.exit(1 if main(**given) is False else 0)


def write(path: Path, rows: Sequence[Row], *, digits: int = 4) -> None:
    """Write rows of the same columns as CSV, numbers with so many significant digits, and print them."""
    texts = [{name: _text(value, digits) for name, value in row.items()} for row in rows]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(texts[0]))
        writer.writeheader()
        writer.writerows(texts)
    widths = {name: max(len(name), *(len(row[name]) for row in texts)) for name in texts[0]}
    print(f"\n{path.name}")
    for row in ({name: name for name in widths}, *texts):
        print("  ".join(row[name].ljust(width) for name, width in widths.items()).rstrip(), flush=True)


def _text(value: object, digits: int) -> str:
    return f"{value:.{digits}g}" if isinstance(value, float | np.floating) else str(value)


def save(figure: Figure, path: Path, *, dpi: int = 90) -> None:
    """Write a figure as PNG without the version of matplotlib, so that equal pictures have equal bytes."""
    figure.savefig(path, format="png", dpi=dpi, metadata={"Software": None})


@dataclass(frozen=True, eq=False)
class Panel:
    """One mesh of a picture.

    `points`, shape (p, 3), are marked in the colours of `values`, shape (p,), in [0, 1]. The surface has one
    `colour`, or those of its vertices in `painted`, shape (n, 3).
    """

    mesh: Mesh
    caption: str
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    values: Floats = field(default_factory=lambda: np.empty(0))
    colour: tuple[float, float, float] = SURFACE
    painted: Floats = field(default_factory=lambda: np.empty((0, 3)))

    def draw(self, axes: Axes3D) -> None:
        """Draw the shaded mesh and its points on three-dimensional axes."""
        vertices, faces = self.mesh.vertices, self.mesh.faces
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, half = 0.5 * (low + high), 0.36 * float(np.linalg.norm(high - low))
        light = 0.45 + 0.55 * np.clip(face_normals(vertices[faces]) @ TOWARDS_LIGHT, 0.0, 1.0)
        colours = self.painted[faces].mean(axis=1) if len(self.painted) else np.array([self.colour])
        corners = list((vertices[faces] - middle) / half)
        alpha = 0.55 if len(self.points) else 1.0
        axes.add_collection3d(Poly3DCollection(corners, facecolors=light[:, None] * colours, alpha=alpha))
        if len(self.points):
            points = ((self.points - middle) / half).T
            axes.scatter(*points, c=colormaps["hsv"](self.values), s=8, depthshade=False)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.35)
        axes.view_init(elev=ELEVATION, azim=AZIMUTH)
        axes.set_axis_off()
        axes.set_title(self.caption, fontsize=8, y=-0.06)


def grid(rows: Sequence[Sequence[Panel]], *, size: float = 2.3) -> Figure:
    """Return a figure with a grid of panels of `size` inches each."""
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(size * columns, size * len(rows)), layout="tight")
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            panel.draw(figure.add_subplot(len(rows), columns, i * columns + j + 1, projection="3d"))
    return figure
