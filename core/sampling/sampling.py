"""Which vertices become samples: the paper's cut, a draw by Lewis weights, and a selection that covers."""

import hashlib

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Floats, Ints
from core.mesh.ordering import tied_ranks
from core.sampling.farthest_point import farthest_points

ROUNDING = 1e-9
"""Weights that differ by less than this part of the largest are equal."""


def sort_and_cut(weights: Floats, count: int) -> Ints:
    """The `count` points of largest weight, the largest first (the paper's selection); ties by order."""
    return np.argsort(-tied_ranks(weights, ROUNDING), kind="stable")[:count].astype(np.int64)


def keyed_uniform(points: Floats, seed: int, digits: int = 4) -> Floats:
    """A number in [0, 1) for each point, keyed to where it is and not to its place in the list.

    Coordinates of the normal frame are rounded to `digits` decimals and hashed with the seed, so the same
    surface gives the same draw whatever the order of its vertices.

    Parameters
    ----------
    points : float64, shape (n, 3)
        In the normal frame.
    seed : int

    Returns
    -------
    float64, shape (n,)
    """
    key = seed.to_bytes(8, "little", signed=True)
    cells = np.rint(np.ascontiguousarray(points) * 10**digits).astype("<i8")
    numbers = [
        int.from_bytes(hashlib.blake2b(cell.tobytes(), digest_size=8, key=key).digest(), "little")
        for cell in cells
    ]
    return np.array(numbers, dtype=np.uint64).astype(np.float64) / 2.0**64


def draw_scale(weights: Floats, count: int) -> float:
    """The c with sum min(1, c q) = count, so that a draw with those probabilities has that mean size."""
    ordered = np.sort(weights[weights > 0.0])[::-1]
    if count >= len(ordered):
        return float(1.0 / ordered[-1]) if len(ordered) else 1.0
    rest = np.cumsum(ordered[::-1])[::-1]
    sure = np.arange(len(ordered))
    scale = (count - sure) / rest
    return float(scale[np.argmax(scale * ordered <= 1.0)])


def random_draw(weights: Floats, count: int, uniform: Floats) -> Ints:
    """A seeded draw of exactly `count` points with inclusion probabilities min(1, c q_i).

    Pareto sampling (Rosen 1997): the points of smallest u_i (1 - p_i) / (p_i (1 - u_i)). Without the fixed
    size a point would be kept when u_i < p_i, which is where that is below 1; with it the probabilities hold
    nearly. Points of p_i = 1 come first, so that each is drawn.

    Parameters
    ----------
    weights : float64, shape (n,)
        Lewis weights, not negative.
    count : int
    uniform : float64, shape (n,)
        Numbers in [0, 1), one a point.
    """
    probability = np.minimum(1.0, draw_scale(weights, count) * weights)
    # Points of no weight come last, in an order of their own.
    ratio = uniform * (1.0 - probability) / (np.maximum(probability, 1e-200) * (1.0 - uniform))
    return np.lexsort((uniform, ratio))[:count].astype(np.int64)


def weighted_farthest_points(
    graph: csr_array, points: Floats, weights: Floats, count: int, power: float
) -> Ints:
    """Farthest-point selection weighted by importance.

    Each next sample maximises distance times (q / mean q)^power, clipped to [1/4, 4]: power 0 is plain
    farthest-point sampling, larger powers put more samples where the Lewis weight is high without leaving
    any region bare. The first is the point farthest from the centroid.

    Parameters
    ----------
    graph : csr_array, shape (n, n)
    points : float64, shape (n, 3)
        In the normal frame.
    weights : float64, shape (n,)
    count : int
    power : float
        >= 0.
    """
    relative = np.clip((weights / weights.mean()) ** power, 0.25, 4.0)
    first = int(np.argmax(tied_ranks(np.linalg.norm(points, axis=1))))
    return farthest_points(graph, count, first, relative)
