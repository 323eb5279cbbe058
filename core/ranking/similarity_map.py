"""A map of shapes: positions on a plane in which similar shapes are near, and cells of a grid."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from core.arrays import Float32s, Floats, Ints
from core.ranking.diffusion import NeighbourRows
from core.ranking.graph_layout import graph_positions


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


def similarity_map(signatures: Float32s, neighbours: NeighbourRows | None = None) -> SimilarityMap:
    """Lay n shapes out by their neighbours, or by their signatures; equal arguments give equal maps.

    The `signatures`, float32 of shape (n, s), are log eigenvalues and global descriptors; the layout of
    neighbours begins with theirs. `neighbours` has the rows of the n shapes in the order of the signatures,
    empty where they are not known.
    """
    if not len(signatures):
        return SimilarityMap(np.empty((0, 2)), np.empty((0, 2), dtype=np.int64), 0)
    positions = principal_positions(signatures)
    if neighbours is not None:
        positions = graph_positions(*neighbours.links(), positions)
    positions -= positions.min(axis=0)
    positions /= positions.max() or 1.0
    positions += (1.0 - positions.max(axis=0)) / 2.0
    cells, size = grid_cells(positions)
    return SimilarityMap(positions, cells, size)


def principal_positions(signatures: Float32s) -> Floats:
    """Return the first two principal components of n >= 1 signatures, shape (n, 2).

    The components are the positions of classical multidimensional scaling (Torgerson 1952) by the Euclidean
    distances of the signatures. Each axis points so that its largest coordinate by magnitude is positive.
    """
    centred = signatures.astype(np.float64) - signatures.mean(axis=0, dtype=np.float64)
    vectors, lengths, _ = np.linalg.svd(centred, full_matrices=False)
    axes = min(2, len(lengths))
    positions = np.zeros((len(centred), 2))
    positions[:, :axes] = vectors[:, :axes] * lengths[:axes]
    largest = positions[np.abs(positions).argmax(axis=0), [0, 1]]
    return np.where(largest < 0.0, -positions, positions)


def grid_cells(positions: Floats) -> tuple[Ints, int]:
    """Give each of n positions in [0, 1] a cell of a square grid.

    The sum of the squared distances between the positions and the centres of their cells is least. The
    results are the column and row of each, int64 of shape (n, 2), from 0, which no two positions share; and
    the number of columns, and of rows: the root of n, rounded up.
    """
    size = int(np.ceil(np.sqrt(len(positions))))
    cells = np.indices((size, size)).reshape(2, -1).T
    costs = (((cells + 0.5) / size - positions[:, None, :]) ** 2).sum(axis=2)
    return cells[linear_sum_assignment(costs)[1]].astype(np.int64), size
