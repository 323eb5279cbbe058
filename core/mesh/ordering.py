"""An order of the vertices that the shape itself gives, so that no later choice hangs on the file's."""

import numpy as np

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, constant
from core.numerics.radix_sort import lexical_order

TIE = 1e-5
"""Lengths that differ by less than this part of the largest are equal: so far may rounding to the single
precision of a file, which changes with the pose, drive them apart."""

ROUNDS, MARKS = 40, 8
"""Most rounds in which vertices tell each other apart, and most vertices marked."""

MOST_VERTICES = 300_000
"""Above this symmetry is not looked for: the order is by distance from the centroid, then the one given."""


def tied_ranks(values: Floats, tolerance: float = TIE) -> Ints:
    """Ranks of the values, shape (n,), 0 for the smallest; values that only rounding tells apart share one.

    Parameters
    ----------
    values : float64, shape (n,)
    tolerance : float
        Gaps up to this part of the largest magnitude are no gaps.
    """
    return _refined_ranks(np.zeros(len(values), dtype=np.int64), values, tolerance)


def independent_weights(ranks: Ints) -> Floats:
    """A weight in (-1, 1) for each rank; no two different sums of them, with rational factors, are equal.

    The sine of rank + 1: sines of whole numbers are linearly independent (Lindemann and Weierstrass).
    """
    return np.asarray(np.sin(ranks + 1.0))


def _refined_ranks(ranks: Ints, values: Floats, tolerance: float = TIE) -> Ints:
    """Ranks by the ranks given, then by the values."""
    order = lexical_order(ranks, values)
    ranked, sorted_values = ranks[order], values[order]
    step = np.zeros(len(order), dtype=np.int64)
    gap = tolerance * float(np.abs(values).max(initial=0.0))
    step[1:] = (ranked[1:] != ranked[:-1]) | (sorted_values[1:] - sorted_values[:-1] > gap)
    result = np.empty(len(order), dtype=np.int64)
    result[order] = np.cumsum(step)
    return result


@compiled
def _side_lengths(vertices: Floats, faces: Ints) -> Floats:
    """Of each face's sides, shape (f, 3), from each corner to the next."""
    lengths = np.empty((len(faces), 3))
    for f in range(len(faces)):
        for i in range(3):
            start, end = faces[f, i], faces[f, (i + 1) % 3]
            square = 0.0
            for axis in range(3):
                square += (vertices[start, axis] - vertices[end, axis]) ** 2
            lengths[f, i] = np.sqrt(square)
    return lengths


@compiled
def _from_neighbours(faces: Ints, lengths: Floats, weights: Floats) -> Floats:
    """For each vertex, the sum over the sides at it of their lengths times their other ends' weights."""
    sums = np.zeros(len(weights))
    for f in range(len(faces)):
        for i in range(3):
            start, end = faces[f, i], faces[f, (i + 1) % 3]
            sums[start] += lengths[f, i] * weights[end]
            sums[end] += lengths[f, i] * weights[start]
    return sums


def canonical_order(vertices: Floats, faces: Ints, centre: Floats) -> Ints:
    """Vertices by their place in the shape: the same order in any pose, however the file lists them.

    First by distance from the centroid. Vertices at equal distance are told apart by their neighbours' ranks
    and the lengths to them, again and again (the colour refinement of graph isomorphism). Those that still
    are alike are so by a symmetry of the mesh: one of them is marked, all others are ranked by their distance
    from it, and so on until no two are alike. Which one is marked makes no difference but that symmetry.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
        Distinct.
    faces : int64, shape (f, 3)
    centre : float64, shape (3,)
        Of the surface.

    Returns
    -------
    int64, shape (n,)
        Vertices, from the one nearest to the centre.
    """
    count = len(vertices)
    ranks = tied_ranks(np.linalg.norm(vertices - centre, axis=1))
    if count > MOST_VERTICES:
        return np.argsort(ranks, kind="stable")
    vertices, faces = constant(vertices), constant(faces)
    lengths = _side_lengths(vertices, faces)
    lengths /= lengths.max()
    for _ in range(MARKS):
        for _ in range(ROUNDS):
            if ranks.max() == count - 1:
                return np.argsort(ranks)
            finer = _refined_ranks(ranks, _from_neighbours(faces, lengths, independent_weights(ranks)))
            told = finer.max() > ranks.max()
            ranks = finer
            if not told:
                break
        alike = np.flatnonzero(np.bincount(ranks)[ranks] > 1)
        marked = alike[np.argmax(ranks[alike])]
        ranks = _refined_ranks(ranks, np.linalg.norm(vertices - vertices[marked], axis=1))
    return np.argsort(ranks, kind="stable")
