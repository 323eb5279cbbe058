"""Fig. 10: a classified collection as thumbnails, in one colour per class, unmatched shapes in grey."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.colors import hsv_to_rgb

from core.evaluation.classification import Classification
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate
from service.rendering.drawing import Panel, draw_grid

UNMATCHED = (0.62, 0.62, 0.62)
COLUMNS = 10
_SIZE = 1.25
_FACES = 2000
"""Faces of a thumbnail; more would not be visible."""


def thumbnail(mesh: Mesh) -> Mesh:
    """The mesh, simplified if it has more faces than a thumbnail shows."""
    return mesh if len(mesh.faces) <= _FACES else decimate(mesh, _FACES / len(mesh.faces), 0)


def class_colour(place: int) -> tuple[float, float, float]:
    """The colour of the class with an index; successive hues differ by the golden ratio."""
    red, green, blue = hsv_to_rgb((0.02 + 0.618034 * place % 1.0, 0.62 - 0.17 * (place % 2), 0.95))
    return float(red), float(green), float(blue)


def classes_picture(meshes: Sequence[Mesh], labels: Sequence[str], found: Classification) -> bytes:
    """A PNG of all shapes: the shapes of each found class in rows of their own, then unmatched ones in grey.

    Parameters
    ----------
    meshes : sequence of n Mesh
    labels : sequence of n str
        True classes; the caption of a misclassified shape has both classes.
    found : Classification
    """
    names = np.asarray(labels)
    order = sorted(set(labels))
    pairs = zip(found.neighbour, found.matched, strict=True)
    given = [str(names[neighbour]) if matched else "" for neighbour, matched in pairs]
    # Unmatched shapes have an empty name, which comes last.
    placed = sorted(range(len(names)), key=lambda i: (given[i] == "", given[i], not found.right[i], i))
    rows: list[list[Panel]] = []
    for name, group in groupby(placed, key=lambda i: given[i]):
        members = list(group)
        colour = class_colour(order.index(name)) if name else UNMATCHED
        panels = [Panel(thumbnail(meshes[i]), _caption(labels[i], name), colour=colour) for i in members]
        rows += [panels[start : start + COLUMNS] for start in range(0, len(panels), COLUMNS)]
    return draw_grid(rows, size=_SIZE)


def _caption(label: str, given: str) -> str:
    if not given:
        return f"{label}?"
    return label if label == given else f"{label}, not {given}"
