"""The canonical order of vertices, which depends on the shape and not on the order in the file."""

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.edges import edge_lengths
from core.numerics.compilation import compiled_for_reading
from core.numerics.radix_sort import lexical_order

TIE = 1e-5
"""Lengths are equal if they differ by less than this fraction of the largest: files in single precision round
coordinates, and the rounding changes with the pose."""

ROUNDS, MARKS = 40, 8
"""Largest number of rounds of colour refinement, and of vertices that are individualised."""

MOST_VERTICES = 300_000
"""Above this number symmetry is not resolved: the order is by distance from the centroid, then as given."""


def tied_ranks(values: Floats, tolerance: float = TIE) -> Ints:
    """Return the ranks of the values, shape (n,), 0 for the smallest; equal but for rounding is tied.

    Neighbouring values share a rank if their gap is at most a fraction, the tolerance, of the largest
    magnitude.
    """
    return _refined_ranks(np.zeros(len(values), dtype=np.int64), values, tolerance)


def independent_weights(ranks: Ints) -> Floats:
    """Return weights in (-1, 1) of the ranks, linearly independent over the rationals.

    The weight is the sine of rank + 1: sines of positive integers are linearly independent over the rationals
    (Lindemann and Weierstrass).
    """
    return np.asarray(np.sin(ranks + 1.0))


def _refined_ranks(ranks: Ints, values: Floats, tolerance: float = TIE) -> Ints:
    """Return the ranks by the given ranks, then by the values with ties up to the tolerance, shape (n,)."""
    order = lexical_order(ranks, values)
    ranked, sorted_values = ranks[order], values[order]
    step = np.zeros(len(order), dtype=np.int64)
    gap = tolerance * float(np.abs(values).max(initial=0.0))
    step[1:] = (ranked[1:] != ranked[:-1]) | (sorted_values[1:] - sorted_values[:-1] > gap)
    result = np.empty(len(order), dtype=np.int64)
    result[order] = np.cumsum(step)
    return result


@compiled_for_reading
def _from_neighbours(faces: Ints, lengths: Floats, weights: Floats) -> Floats:
    """Return sums over the sides at each vertex of length times weight of the other end, shape (n,)."""
    sums = np.zeros(len(weights))
    for f in range(len(faces)):
        for i in range(3):
            start, end = faces[f, i], faces[f, (i + 1) % 3]
            sums[start] += lengths[f, i] * weights[end]
            sums[end] += lengths[f, i] * weights[start]
    return sums


def canonical_order(vertices: Floats, faces: Ints, centre: Floats) -> Ints:
    """Return the canonical order of the vertices, the same in any pose and for any order of the file.

    Vertices are ranked by distance from the centroid. Colour refinement (Weisfeiler and Leman 1968) separates
    equal ranks by the neighbours' ranks and the lengths of the edges to them. Vertices that remain equal are
    images of each other under a symmetry of the mesh: one is individualised, all others are ranked by the
    distance from it, and refinement continues. The choice changes the order by that symmetry only.

    The `vertices`, shape (n, 3), are distinct; the one nearest to the `centre`, the centroid of the surface,
    comes first in the order, shape (n,).
    """
    count = len(vertices)
    ranks = tied_ranks(np.linalg.norm(vertices - centre, axis=1))
    if count > MOST_VERTICES:
        return np.argsort(ranks, kind="stable")
    sides = np.stack([faces, faces[:, [1, 2, 0]]], axis=2)
    lengths = edge_lengths(vertices, sides.reshape(-1, 2)).reshape(-1, 3)
    lengths /= lengths.max()
    for _ in range(MARKS):
        for _ in range(ROUNDS):
            if ranks.max() == count - 1:
                return np.argsort(ranks)
            finer = _refined_ranks(ranks, _from_neighbours(faces, lengths, independent_weights(ranks)))
            refined = finer.max() > ranks.max()
            ranks = finer
            if not refined:
                break
        tied = np.flatnonzero(np.bincount(ranks)[ranks] > 1)
        if not len(tied):
            # The last round has separated all vertices.
            break
        marked = tied[np.argmax(ranks[tied])]
        ranks = _refined_ranks(ranks, np.linalg.norm(vertices - vertices[marked], axis=1))
    return np.argsort(ranks, kind="stable")
