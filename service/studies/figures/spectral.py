"""Figs. 3, 5 and 6: samples, the spectral eigenmap, and a matched pair."""

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.dense.functional_maps import basis, extend
from core.embedding import Embedding
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.rendering.drawing import Panel, draw_grid, draw_panel, png
from tests.core.matching.reference import fit_rotation_reference

TAUS = (0.1, 0.2, 0.5)
_LARGEST = 0.85
"""The end of the hue scale, short of a full circle, so that both ends differ."""


def samples_figure(mesh: Mesh) -> bytes:
    """Fig. 3: the samples of the default parameters at three sparse ratios tau."""
    panels = []
    for tau in TAUS:
        points = (
            Pipeline(DEFAULT.with_values(sampling={"samples": 0, "tau": tau}))
            .embed(mesh)
            .positions.astype(np.float64)
        )
        caption = f"tau {tau}: {len(points)} samples"
        panels.append(Panel(mesh, caption, points, np.full(len(points), 0.62), size=2.5))
    return draw_grid([panels], size=3.2)


def eigenmap_figure(mesh: Mesh) -> bytes:
    """Fig. 5: the samples coloured by each of the first three coordinates, and the spectral domain."""
    embedding = Pipeline(DEFAULT).embed(mesh)
    cloud, points = _cloud(embedding), embedding.positions.astype(np.float64)
    figure = Figure(figsize=(11.5, 3.0), layout="tight")
    FigureCanvasAgg(figure)
    for i in range(3):
        axes = figure.add_subplot(1, 4, i + 1, projection="3d")
        draw_panel(axes, Panel(mesh, f"coordinate {i + 1}", points, _scale(cloud[:, i])))
    domain: Axes3D = figure.add_subplot(1, 4, 4, projection="3d")
    for edge in embedding.tree_edges:
        domain.plot(*cloud[edge, :3].T, color="0.75", linewidth=0.7)
    domain.scatter(*cloud[:, :3].T, c=colormaps["hsv"](_scale(cloud[:, 0])), s=12, depthshade=False)
    _bare(domain, "spectral domain, and the tree")
    return png(figure)


def match_figure(first: Mesh, second: Mesh) -> bytes:
    """Fig. 6: matched samples, the correspondence of all vertices, and the two clouds before and after."""
    first, second = clean(first).mesh, clean(second).mesh
    pipeline = Pipeline(DEFAULT)
    embeddings = pipeline.embed(first), pipeline.embed(second)
    match = pipeline.match(*embeddings)
    one, two = match.correspondence.T
    clouds = [_cloud(embedding) for embedding in embeddings]
    places = [
        embedding.positions[samples].astype(np.float64)
        for embedding, samples in zip(embeddings, (one, two), strict=True)
    ]
    colours = _painted(first)
    partners = _partners(first, second, places)
    hues = _scale(normal_frame(first).apply(places[0])[:, 0])
    figure = Figure(figsize=(9.5, 6.2), layout="tight")
    FigureCanvasAgg(figure)
    panels = [
        [
            Panel(first, "matched samples", places[0], hues),
            Panel(second, f"CC {match.cc:.3f}", places[1], hues),
        ],
        [Panel(first, "all vertices", painted=colours), Panel(second, "", painted=colours[partners])],
    ]
    rotation = fit_rotation_reference(clouds[0][one], clouds[1][two], 1)[1]
    views = [("spectral domain", clouds[0]), ("after the orthogonal map", clouds[0] @ rotation)]
    for row, (pair, (caption, cloud)) in enumerate(zip(panels, views, strict=True)):
        for column, panel in enumerate(pair):
            draw_panel(figure.add_subplot(2, 3, 3 * row + column + 1, projection="3d"), panel)
        axes: Axes3D = figure.add_subplot(2, 3, 3 * row + 3, projection="3d")
        rgba = colormaps["hsv"](hues)
        axes.scatter(*cloud[one, :3].T, c=rgba, s=12, depthshade=False)
        axes.scatter(*clouds[1][two, :3].T, c=rgba, s=12, marker="^", depthshade=False)
        if row == 1:
            for i, j in zip(one, two, strict=True):
                axes.plot(*np.stack([cloud[i, :3], clouds[1][j, :3]]).T, color="0.6", linewidth=0.6)
        _bare(axes, caption)
    return png(figure)


def _cloud(embedding: Embedding) -> Floats:
    """The samples in the first spectral domain, shape (m, k)."""
    return embedding.spectra[0].coordinates[: len(embedding.positions)].astype(np.float64)


def _partners(first: Mesh, second: Mesh, places: list[Floats]) -> Ints:
    """For each vertex of the second mesh, the corresponding vertex of the first."""
    ends = [cKDTree(mesh.vertices).query(at)[1] for mesh, at in zip((first, second), places, strict=True)]
    return extend(basis(second), basis(first), np.stack(ends[::-1], axis=1).astype(np.int64))


def _painted(mesh: Mesh) -> Floats:
    """Vertex colours by position along the axes of the normal frame, shape (n, 3)."""
    places = normal_frame(mesh).apply(mesh.vertices)
    low, high = places.min(axis=0), places.max(axis=0)
    return np.asarray(0.1 + 0.85 * (places - low) / np.maximum(high - low, 1e-300))


def _scale(values: Floats) -> Floats:
    """Ranks of the values, scaled from 0 to the end of the hue scale."""
    return np.asarray(_LARGEST * np.argsort(np.argsort(values, kind="stable")) / len(values))


def _bare(axes: Axes3D, caption: str) -> None:
    axes.set(xticklabels=[], yticklabels=[], zticklabels=[])
    axes.tick_params(length=0)
    axes.set_title(caption, fontsize=8, y=-0.06)
