"""Selection of samples by Lewis weight: sort and cut, random draw, weighted farthest-point sampling."""

import hashlib

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Floats, Ints
from core.mesh.ordering import tied_ranks
from core.sampling.farthest_point import farthest_points

ROUNDING = 1e-9
"""Weights are equal if they differ by less than this fraction of the largest."""


def sort_and_cut(weights: Floats, count: int) -> Ints:
    """The `count` points of largest weight, descending (the paper's selection), shape (count,).

    Ties are broken by the order of the points.

    Parameters
    ----------
    weights : float64, shape (n,)
        Lewis weights, >= 0.
    count : int
        At most n.
    """
    return np.argsort(-tied_ranks(weights, ROUNDING), kind="stable")[:count].astype(np.int64)


def keyed_uniform(points: Floats, seed: int, digits: int = 4) -> Floats:
    """Pseudo-random numbers in [0, 1), one for each point, that depend on the position and not on the order.

    Coordinates are rounded to `digits` decimals and hashed with the seed, so a surface gives the same draw
    for any order of its vertices.

    Parameters
    ----------
    points : float64, shape (n, 3)
        In the normal frame.
    seed : int
        Key of the hash, a signed 64-bit number.
    digits : int
        Number of decimals.

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
    """The c with sum min(1, c q) = count: a draw with these probabilities has `count` points on average."""
    ordered = np.sort(weights[weights > 0.0])[::-1]
    if count >= len(ordered):
        return float(1.0 / ordered[-1]) if len(ordered) else 1.0
    rest = np.cumsum(ordered[::-1])[::-1]
    sure = np.arange(len(ordered))
    scale = (count - sure) / rest
    return float(scale[np.argmax(scale * ordered <= 1.0)])


def random_draw(weights: Floats, count: int, uniform: Floats) -> Ints:
    """A draw of exactly `count` points with inclusion probabilities p_i = min(1, c q_i), shape (count,).

    Pareto sampling (Rosen 1997) selects the points of smallest u_i (1 - p_i) / (p_i (1 - u_i)). Poisson
    sampling keeps a point if this ratio is below 1; the fixed size changes the probabilities slightly. Every
    point with p_i = 1 is selected.

    Parameters
    ----------
    weights : float64, shape (n,)
        Lewis weights, >= 0.
    count : int
        At most n.
    uniform : float64, shape (n,)
        Uniform numbers u_i in [0, 1).
    """
    probability = np.minimum(1.0, draw_scale(weights, count) * weights)
    # Points of weight 0 come last, ordered by `uniform`.
    ratio = uniform * (1.0 - probability) / (np.maximum(probability, 1e-200) * (1.0 - uniform))
    return np.lexsort((uniform, ratio))[:count].astype(np.int64)


def weighted_farthest_points(
    graph: csr_array, points: Floats, weights: Floats, count: int, power: float
) -> Ints:
    """Farthest-point sampling weighted by Lewis weights, shape (count,).

    Each sample maximises distance times (q / mean q)^power, the factor clipped to [1/4, 4]. Power 0 is plain
    farthest-point sampling; a larger power puts more samples where the Lewis weight is high and still covers
    every region. The first sample is the point farthest from the centroid.

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric and connected, with positive lengths.
    points : float64, shape (n, 3)
        In the normal frame.
    weights : float64, shape (n,)
        Lewis weights q, >= 0.
    count : int
        Number of samples, 1 to n.
    power : float
        >= 0.
    """
    relative = np.clip((weights / weights.mean()) ** power, 0.25, 4.0)
    first = int(np.argmax(tied_ranks(np.linalg.norm(points, axis=1))))
    return farthest_points(graph, count, first, relative)
