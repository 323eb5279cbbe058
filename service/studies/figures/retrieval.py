"""Table 3 and the confusion matrix of a collection's scores."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from core.evaluation.retrieval_measures import Evaluation
from core.mesh.mesh import Mesh
from service.rendering.drawing import SURFACE, Panel, draw_grid, png
from service.studies.figures.classes import thumbnail

OTHER_CLASS = (0.93, 0.55, 0.45)
_FOUND = 3


def top_figure(
    meshes: Sequence[Mesh], labels: Sequence[str], closeness: NDArray[np.float64], score: str
) -> bytes:
    """Table 3: the first shape of each class as a query, and the three most similar other shapes.

    Parameters
    ----------
    meshes : sequence of n Mesh
    labels : sequence of n str
    closeness : float64, shape (n, n)
        Similarities; the diagonal is ignored.
    score : str
        The name of the score in the captions.
    """
    blocks: list[list[Panel]] = []
    for label in sorted(set(labels)):
        query = labels.index(label)
        row = closeness[query].copy()
        row[query] = -np.inf
        block = [Panel(thumbnail(meshes[query]), f"query: {label}")]
        for i in np.argsort(-row, kind="stable")[:_FOUND]:
            colour = SURFACE if labels[i] == label else OTHER_CLASS
            block.append(Panel(thumbnail(meshes[i]), f"{labels[i]}  {score} {row[i]:.3f}", colour=colour))
        blocks.append(block)
    rows = [[*chain.from_iterable(blocks[i : i + 2])] for i in range(0, len(blocks), 2)]
    return draw_grid(rows, size=1.5)


def confusion_figure(figures: Evaluation, score: str) -> bytes:
    """The number of queries of each class (row) whose first neighbour has each class (column)."""
    counts, names = figures.confusion, figures.classes
    side = 1.6 + 0.32 * len(names)
    figure = Figure(figsize=(side, side), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for i, j in zip(*np.nonzero(counts), strict=True):
        colour = "white" if shares[i, j] > 0.6 else "black"
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_xlabel(f"class of the first neighbour by {score}", fontsize=8)
    axes.set_ylabel("class of the query", fontsize=8)
    axes.set_title(f"NN {figures.nn:.3f}", fontsize=9)
    return png(figure)
