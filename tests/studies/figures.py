"""The paper's figures: samples (3), eigenmap (5), match (6), first answers (Table 3), classes (10).

    python -m tests.studies.figures DIR [--collection COLLECTION] [--shown person] [--limit 38]

Without a collection the shapes are made by code, and the match shows one body in two poses.
"""

from collections.abc import Sequence
from itertools import chain, groupby, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from scipy.spatial import cKDTree

from core.arrays import Floats
from core.dense.functional_maps import FINE, basis, functional_map
from core.embedding import Embedding
from core.evaluation.classification import Classification, classify
from core.evaluation.retrieval_measures import Evaluation
from core.gallery import CLASSES, make_shape
from core.gallery.bodies import make_body
from core.io import format_of, read_mesh, write_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.mesh.simplification import decimate
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.evaluation.retrieval import collection_files, evaluate_ranking, score_collection
from tests.core.matching.reference import fit_rotation_reference
from tests.studies.common import SURFACE, Panel, grid, run, save

POSES = 4
TAUS = (0.1, 0.2, 0.5)
UNMATCHED, OTHER_CLASS = (0.62, 0.62, 0.62), (0.93, 0.55, 0.45)
COLUMNS, FACES = 10, 2000
"""Thumbnails in a row of the picture of classes, and faces of a thumbnail: more would not be visible."""


def thumbnail(mesh: Mesh) -> Mesh:
    """Return the mesh, simplified if it has more faces than a thumbnail shows."""
    return mesh if len(mesh.faces) <= FACES else decimate(mesh, FACES / len(mesh.faces), 0)


def ranks(values: Floats) -> Floats:
    """Return the ranks of values on the scale of hues, short of a full circle, so that both ends differ."""
    return np.asarray(0.85 * np.argsort(np.argsort(values, kind="stable")) / len(values))


def cloud_of(embedding: Embedding) -> Floats:
    """Return the samples in the first spectral domain, shape (m, k)."""
    return embedding.spectra[0].coordinates[: len(embedding.positions)].astype(np.float64)


def bare(axes: Axes3D, caption: str) -> None:
    """Leave out the numbers of the axes."""
    axes.set(xticklabels=[], yticklabels=[], zticklabels=[])
    axes.set_title(caption, fontsize=8, y=-0.06)


def samples_figure(mesh: Mesh) -> Figure:
    """Draw Fig. 3: the samples of the default parameters at three sparse ratios."""
    panels = []
    for tau in TAUS:
        pipeline = Pipeline(DEFAULT.with_values(sampling={"samples": 0, "tau": tau}))
        points = pipeline.embed(mesh).positions.astype(np.float64)
        panels.append(Panel(mesh, f"tau {tau}: {len(points)} samples", points, np.full(len(points), 0.62)))
    return grid([panels], size=3.2)


def eigenmap_figure(mesh: Mesh) -> Figure:
    """Draw Fig. 5: the samples coloured by each of three coordinates, and the spectral domain."""
    embedding = Pipeline(DEFAULT).embed(mesh)
    cloud, points = cloud_of(embedding), embedding.positions.astype(np.float64)
    figure = Figure(figsize=(11.5, 3.0), layout="tight")
    for i in range(3):
        panel = Panel(mesh, f"coordinate {i + 1}", points, ranks(cloud[:, i]))
        panel.draw(figure.add_subplot(1, 4, i + 1, projection="3d"))
    domain = figure.add_subplot(1, 4, 4, projection="3d")
    for edge in embedding.tree_edges:
        domain.plot(*cloud[edge, :3].T, color="0.75", linewidth=0.7)
    domain.scatter(*cloud[:, :3].T, c=colormaps["hsv"](ranks(cloud[:, 0])), s=12, depthshade=False)
    bare(domain, "spectral domain, and the tree")
    return figure


def match_figure(first: Mesh, second: Mesh) -> Figure:
    """Draw Fig. 6: matched samples, all vertices, and the two clouds before and after the orthogonal map."""
    first, second = clean(first).mesh, clean(second).mesh
    pipeline = Pipeline(DEFAULT)
    embeddings = pipeline.embed(first), pipeline.embed(second)
    match = pipeline.match(*embeddings)
    left, right = match.correspondence.T
    clouds = [cloud_of(embedding) for embedding in embeddings]
    points = match.points(*embeddings)
    ends = [cKDTree(mesh.vertices).query(at)[1] for mesh, at in ((second, points[1]), (first, points[0]))]
    bases = basis(second, FINE), basis(first, FINE)
    partners = functional_map(*bases, np.stack(ends, axis=1).astype(np.int64)).partners(*bases)
    vertices = normal_frame(first).apply(first.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    painted = np.asarray(0.1 + 0.85 * (vertices - low) / np.maximum(high - low, 1e-300))
    hues = ranks(normal_frame(first).apply(points[0])[:, 0])
    figure = Figure(figsize=(9.5, 6.2), layout="tight")
    panels = [
        Panel(first, "matched samples", points[0], hues),
        Panel(second, f"CC {match.cc:.3f}", points[1], hues),
    ]
    panels += [Panel(first, "all vertices", painted=painted), Panel(second, "", painted=painted[partners])]
    for place, panel in zip((1, 2, 4, 5), panels, strict=True):
        panel.draw(figure.add_subplot(2, 3, place, projection="3d"))
    rotation = fit_rotation_reference(clouds[0][left], clouds[1][right], 1)[1]
    views = [("spectral domain", clouds[0]), ("after the orthogonal map", clouds[0] @ rotation)]
    for place, (caption, cloud) in zip((3, 6), views, strict=True):
        axes = figure.add_subplot(2, 3, place, projection="3d")
        for matched, marker in ((cloud[left], "o"), (clouds[1][right], "^")):
            axes.scatter(*matched[:, :3].T, c=colormaps["hsv"](hues), s=12, marker=marker, depthshade=False)
        bare(axes, caption)
    return figure


def first_answers(meshes: Sequence[Mesh], labels: Sequence[str], cc: Floats) -> Figure:
    """Draw Table 3: the first shape of each class as a query, and the three most similar other shapes."""
    blocks = []
    for label in sorted(set(labels)):
        query = labels.index(label)
        row = np.where(np.arange(len(labels)) == query, -np.inf, cc[query])
        block = [Panel(thumbnail(meshes[query]), f"query: {label}")]
        for i in np.argsort(-row, kind="stable")[:3]:
            colour = SURFACE if labels[i] == label else OTHER_CLASS
            block.append(Panel(thumbnail(meshes[i]), f"{labels[i]}  CC {row[i]:.3f}", colour=colour))
        blocks.append(block)
    return grid([[*chain.from_iterable(blocks[i : i + 2])] for i in range(0, len(blocks), 2)], size=1.5)


def confusion_figure(figures: Evaluation) -> Figure:
    """Draw the number of queries of each class (row) whose first neighbour has each class (column)."""
    counts, names = figures.confusion, figures.classes
    side = 1.6 + 0.32 * len(names)
    figure = Figure(figsize=(side, side), layout="constrained")
    axes = figure.add_subplot()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=7, color="C1")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set(
        xlabel="class of the first neighbour by CC", ylabel="class of the query", title=f"NN {figures.nn:.3f}"
    )
    return figure


def classes_figure(meshes: Sequence[Mesh], labels: Sequence[str], found: Classification) -> Figure:
    """Draw Fig. 10: the shapes of each class found in rows of one colour, unmatched ones in grey."""
    classes = sorted(set(labels))
    given = [labels[i] if matched else "" for i, matched in zip(found.neighbour, found.matched, strict=True)]
    # Unmatched shapes have an empty name, which comes last.
    order = sorted(range(len(labels)), key=lambda i: (given[i] == "", given[i], not found.right[i], i))
    rows: list[list[Panel]] = []
    for name, group in groupby(order, key=lambda i: given[i]):
        colour = UNMATCHED
        if name:
            place = classes.index(name)
            hue, saturation = 0.02 + 0.618034 * place % 1.0, 0.62 - 0.17 * (place % 2)
            colour = tuple(map(float, hsv_to_rgb((hue, saturation, 0.95))))
        panels = [
            Panel(thumbnail(meshes[i]), labels[i] if labels[i] == name else f"{labels[i]}?", colour=colour)
            for i in group
        ]
        rows += [panels[start : start + COLUMNS] for start in range(0, len(panels), COLUMNS)]
    return grid(rows, size=1.25)


def write_gallery(folder: Path) -> None:
    """Write made shapes as a collection."""
    for label, pose in product(CLASSES, range(POSES)):
        path = folder / label / f"{label}-{pose:02d}.ply"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(write_mesh(make_shape(label, pose), "ply"))


def main(folder: Path, collection: Path | None, shown: str, limit: int | None, workers: int | None) -> None:
    """Draw the six figures."""
    with TemporaryDirectory() as scratch:
        if collection is None:
            write_gallery(Path(scratch))
        files = collection_files(collection or Path(scratch), limit)
        classes = {str(path): label for path, label in files}
        named = [(path, str(path)) for path, _ in files]
        names, scores = score_collection(named, DEFAULT, workers)
        meshes = [read_mesh(Path(name).read_bytes(), format_of(name)) for name in names]
    labels = [classes[name] for name in names]
    if collection is None:
        body = make_body(shown)
        pair = body.posed(0), body.posed(1)
    else:
        chosen = [mesh for mesh, label in zip(meshes, labels, strict=True) if label == shown]
        pair = chosen[0], chosen[1]
    pictures = {
        "samples": samples_figure(pair[0]),
        "eigenmap": eigenmap_figure(pair[0]),
        "match": match_figure(*pair),
        "top": first_answers(meshes, labels, scores.cc),
        "confusion": confusion_figure(evaluate_ranking(scores, labels, "cc")),
        "classes": classes_figure(meshes, labels, classify(scores.cc, labels, larger_is_closer=True)),
    }
    for name, figure in pictures.items():
        save(figure, folder / f"figures-{name}.png")


if __name__ == "__main__":
    run(main, __doc__, collection=Path, shown="person", limit=int, workers=int)
