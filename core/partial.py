"""Part in whole: how well a part of a surface is found again on another, by what lies about its points.

A. E. Johnson, M. Hebert, "Using spin images for efficient object recognition in cluttered 3D scenes", IEEE
PAMI 21(5), 1999: about a point with its normal, the surface nearby is a histogram over the distance from the
normal's line and the height along it. It changes little where a limb bends elsewhere, and not at all where a
part was cut away farther off. Scores are one-sided: each of the part's points needs a like one on the whole,
and the whole's may have none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.cleaning import clean, face_areas
from core.edges import half_edges
from core.embedding import Float32s
from core.mesh import Floats, Mesh
from core.outline import spread

POINTS, KEYS = 4000, 160
"""Points that stand for a whole surface, and how many of them have a histogram."""

RADII = (0.15, 0.3)
"""Of the balls that are looked at, over the root of the whole's area."""

ACROSS, ALONG = 5, 9
"""Bins from the normal's line outwards, and along it: as many below the point as above, and one about its
own height, where flat surfaces lie."""

MISSING = (0.0, 0.3, 0.5, 0.7)
"""Shares of the area that may be gone: sizes are those of the whole, which is not known, so all are tried."""

RIM = 0.12
"""Nearer to the open rim than this, over the root of the whole's area, a point counts as `AT_RIM`."""

AT_RIM = 0.02

AT_ONCE = 32
"""How many wholes are compared at a time."""


@dataclass(frozen=True, eq=False)
class Part:
    """A surface, taken for what is left when a share of its area is gone.

    Attributes
    ----------
    patches : float32, shape (k, b)
        What lies about each of its points.
    weights : float64, shape (k,)
        How much each counts; they sum to 1.
    """

    patches: Float32s
    weights: Floats


def patches(mesh: Mesh) -> Float32s:
    """What lies about the points of a whole surface, shape (KEYS, b).

    Raises
    ------
    DegenerateMeshError
        It has no area.
    """
    return _patches(clean(mesh).mesh, 0.0)[0]


def parts(mesh: Mesh) -> list[Part]:
    """A surface as a part, for each share of `MISSING`.

    Raises
    ------
    DegenerateMeshError
        It has no area.
    """
    surface = clean(mesh).mesh
    rim = _rim(surface)
    tree = cKDTree(rim) if len(rim) else None
    made = []
    for missing in MISSING:
        found, keys, unit = _patches(surface, missing)
        near = np.zeros(len(keys), dtype=bool) if tree is None else tree.query(keys)[0] < RIM * unit
        weights = np.where(near, AT_RIM, 1.0)
        made.append(Part(found, weights / weights.sum()))
    return made


def part_distances(queries: Sequence[Part], wholes: Sequence[Float32s]) -> Floats:
    """How far the patches of a part are from the nearest of each of c wholes, shape (c,), >= 0.

    The mean squared distance, for the share of missing area that makes it least. It is 0 for the whole
    itself; how much it is for a part hangs on how it was cut, so that only the order of several tells.

    Parameters
    ----------
    queries : sequence of Part
        As `parts` gives them.
    wholes : sequence of float32, each of shape (KEYS, b)
        As `patches` gives them.
    """
    found = np.full(len(wholes), np.inf)
    for start in range(0, len(wholes), AT_ONCE):
        some = np.stack(wholes[start : start + AT_ONCE])
        flat = some.reshape(-1, some.shape[-1])
        squares = (flat**2).sum(axis=1)
        for query in queries:
            between = squares - 2.0 * query.patches @ flat.T
            least = between.reshape(len(query.patches), len(some), -1).min(axis=2)
            least += (query.patches**2).sum(axis=1)[:, None]
            told = query.weights @ np.maximum(least, 0.0)
            found[start : start + len(some)] = np.minimum(found[start : start + len(some)], told)
    return found


def _patches(surface: Mesh, missing: float) -> tuple[Float32s, Floats, float]:
    """Histograms, the points they are about in the file's units, and the root of the whole's area in these.

    Points are as dense on a part as on the whole, so that what chance adds to a bin is the same.
    """
    areas = face_areas(surface.vertices, surface.faces)
    corners = surface.vertices[surface.faces]
    unit = float(np.sqrt(areas.sum() / (1.0 - missing)))
    count = round(POINTS * (1.0 - missing))
    points, faces = spread((corners - corners.mean(axis=(0, 1))) / unit, areas, count)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[faces]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    keys = np.linspace(0, count - 1, round(KEYS * (1.0 - missing))).astype(np.int64)
    here, up = points[keys], normals[keys]
    squares = (here**2).sum(axis=1)[:, None] + (points**2).sum(axis=1) - 2.0 * here @ points.T
    height = up @ points.T - (here * up).sum(axis=1)[:, None]
    away = np.sqrt(np.maximum(squares - height**2, 0.0))
    made = [_histograms(squares, away, height, radius) for radius in RADII]
    return np.concatenate(made, axis=1), here * unit + corners.mean(axis=(0, 1)), unit


def _histograms(squares: Floats, away: Floats, height: Floats, radius: float) -> Float32s:
    """The roots of the shares of the area of a disc that lie in each bin, shape (k, ACROSS * ALONG)."""
    column = np.minimum((away * (ACROSS / radius)).astype(np.int64), ACROSS - 1)
    row = np.clip(((height / radius + 1.0) * (ALONG / 2)).astype(np.int64), 0, ALONG - 1)
    bins = (np.arange(len(squares))[:, None] * ACROSS + column) * ALONG + row
    inside = bins[squares < radius**2]
    counts = np.bincount(inside, minlength=len(squares) * ACROSS * ALONG)
    shares = counts.reshape(len(squares), ACROSS * ALONG) / (POINTS * radius**2)
    return np.sqrt(shares).astype(np.float32)


def _rim(surface: Mesh) -> Floats:
    """The middles of the open edges, shape (b, 3)."""
    sides = half_edges(surface.faces)
    return np.asarray(surface.vertices[sides.edges[sides.sheets == 1]].mean(axis=1))
