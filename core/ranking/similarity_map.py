"""A map of shapes: positions on a plane in which similar shapes are near each other, and cells of a grid.

The positions are those of t-SNE (van der Maaten and Hinton 2008), by scikit-learn, which starts with
classical multidimensional scaling, so that equal shapes give equal maps. The cells keep pictures apart: each
shape takes one, so that the sum of the squared distances from the positions is least.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from core.arrays import Float32s, Floats, Ints
from core.ranking.coarse_differences import CoarseDescriptors, coarse_differences
from core.ranking.opinion_pool import pooled_log_odds
from core.ranking.spectral_distance import spectral_distances

PERPLEXITY = 30.0
"""Effective number of neighbours of a shape; smaller maps take a third of their shapes."""

ROUNDS = 500
"""Iterations of t-SNE. Maps of 2,000 shapes hardly change afterwards."""

FREE = 1.5
"""Cells over shapes: free cells show the gaps between groups."""

FEW = 16
"""Fewer shapes lie where the start puts them."""


@dataclass(frozen=True, eq=False)
class SimilarityMap:
    """A map of n shapes.

    Attributes
    ----------
    positions : float64, shape (n, 2)
        In [0, 1].
    cells : int64, shape (n, 2)
        Column and row of each shape, from 0; no two shapes have the same.
    size : int
        Number of columns, and of rows.
    """

    positions: Floats
    cells: Ints
    size: int


def dissimilarities_by_log_odds(shapes: CoarseDescriptors) -> Floats:
    """Dissimilarities of n >= 1 shapes with views, shape (n, n), >= 0: log odds below the greatest of all."""
    rows = []
    for i in range(len(shapes.signatures)):
        one = CoarseDescriptors(
            shapes.signatures[i : i + 1], shapes.view_signatures[i : i + 1], shapes.reliabilities[i : i + 1]
        )
        rows.append(pooled_log_odds(coarse_differences(one, shapes)))
    log_odds = np.array(rows)
    np.fill_diagonal(log_odds, log_odds.max())
    return np.asarray(log_odds.max() - 0.5 * (log_odds + log_odds.T))


def dissimilarities_by_signature(signatures: Float32s, *, global_descriptors: bool) -> Floats:
    """Spectral distances of n shapes, shape (n, n), >= 0."""
    return np.array(
        [spectral_distances(one, signatures, global_descriptors=global_descriptors) for one in signatures]
    )


def similarity_map(dissimilarities: Floats) -> SimilarityMap:
    """The map of n shapes.

    Parameters
    ----------
    dissimilarities : float64, shape (n, n)
        Symmetric, >= 0, 0 on the diagonal.
    """
    count = len(dissimilarities)
    if count == 0:
        return SimilarityMap(np.empty((0, 2)), np.empty((0, 2), dtype=np.int64), 0)
    places = classical_scaling(dissimilarities)
    if count >= FEW:
        # Loading scikit-learn takes a second, and a service may never draw a map.
        from sklearn.manifold import TSNE  # noqa: PLC0415

        places = TSNE(
            metric="precomputed",
            init=1e-4 * places / (places[:, 0].std() or 1.0),
            perplexity=min(PERPLEXITY, count / 3.0),
            max_iter=ROUNDS,
            random_state=0,
        ).fit_transform(dissimilarities)
    places = places.astype(np.float64)
    places -= places.min(axis=0)
    places /= places.max() or 1.0
    places += (1.0 - places.max(axis=0)) / 2.0
    size = int(np.ceil(np.sqrt(FREE * count)))
    return SimilarityMap(places, in_cells(places, size), size)


def classical_scaling(dissimilarities: Floats) -> Floats:
    """Positions of n >= 1 shapes by classical multidimensional scaling (Torgerson 1952), shape (n, 2).

    Each axis points so that its largest coordinate by magnitude is positive.
    """
    squares = dissimilarities**2
    means = squares.mean(axis=0)
    products = -0.5 * (squares - means[:, None] - means[None, :] + means.mean())
    values, vectors = np.linalg.eigh(products)
    places = np.zeros((len(squares), 2))
    order = np.argsort(values)[::-1][:2]
    places[:, : len(order)] = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    largest = places[np.abs(places).argmax(axis=0), [0, 1]]
    return np.where(largest < 0.0, -places, places)


def in_cells(positions: Floats, size: int) -> Ints:
    """A cell of a grid of size by size for each of n positions in [0, 1], shape (n, 2); none has two.

    The sum of the squared distances between the positions and the centres of their cells is least.
    """
    columns, rows = np.meshgrid(np.arange(size), np.arange(size))
    cells = np.stack([columns.ravel(), rows.ravel()], axis=1)
    centres = (cells + 0.5) / size
    costs = ((positions[:, None, :] - centres[None, :, :]) ** 2).sum(axis=2)
    return np.asarray(cells[linear_sum_assignment(costs)[1]], dtype=np.int64)
