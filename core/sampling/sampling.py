"""Selection of the embedded vertices by Lewis weight: sort and cut, random draw, weighted farthest points."""

import hashlib

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Floats, Ints
from core.errors import DegenerateMeshError
from core.graph.geodesics import farthest_points
from core.mesh.mesh import Mesh
from core.mesh.ordering import tied_ranks
from core.parameters import Parameters
from core.sampling.lewis_weights import lewis_weights

ROUNDING = 1e-9
"""Weights are equal if they differ by less than this fraction of the largest."""


def embedded_points(mesh: Mesh, graph: csr_array, parameters: Parameters) -> tuple[Ints, int]:
    """Return the vertices that are embedded, shape (d,), and the number m of samples, which come first.

    The mesh is in its normal frame, and the graph its edge graph. Raise DegenerateMeshError if there are too
    few vertices for the dimensions.
    """
    wanted, spectral = parameters.sampling, parameters.spectral
    count = wanted.samples or round(wanted.tau * len(mesh.vertices))
    count = min(count, wanted.sample_cap or count, len(mesh.vertices))
    if count < spectral.dimensions + 2:
        raise DegenerateMeshError(f"only {count} samples for {spectral.dimensions} dimensions")
    drawn = wanted.selection == "random-draw"
    weights = lewis_weights(
        mesh.vertices,
        degree=wanted.degree,
        epsilon=wanted.epsilon,
        normalise=wanted.normalise_weights,
        random=keyed_uniform(mesh.vertices, wanted.seed + 1) if drawn else None,
    ).weights
    if wanted.selection == "sort-and-cut":
        return sort_and_cut(weights, count), count
    if drawn:
        return random_draw(weights, count, keyed_uniform(mesh.vertices, wanted.seed)), count
    more = spectral.distances == "geodesic" and spectral.affinity == "gaussian"
    points = min(max(wanted.points if more else 0, count), len(mesh.vertices))
    return weighted_farthest_points(graph, mesh.vertices, weights, points, wanted.coverage_power), count


def least_vertices(parameters: Parameters) -> int:
    """Return the least number of vertices for the samples, and for the eigenvalues of the signature.

    `core.mesh.subdivision.refine` leaves edges up to 1.5 times the even side, so it may make 2.25 times fewer
    vertices than asked.
    """
    wanted, spectral = parameters.sampling, parameters.spectral
    samples = max(spectral.dimensions + 2, spectral.affinity_values)
    asked = wanted.samples or int(np.ceil(samples / wanted.tau))
    return int(np.ceil(2.5 * max(asked, samples, spectral.laplacian_values + 2)))


def sort_and_cut(weights: Floats, count: int) -> Ints:
    """Return the `count` points of largest weight, descending (the paper's selection), shape (count,).

    Ties are broken by the order of the points.
    """
    return np.argsort(-tied_ranks(weights, ROUNDING), kind="stable")[:count].astype(np.int64)


def keyed_uniform(points: Floats, seed: int) -> Floats:
    """Return pseudo-random numbers in [0, 1), one for each point, that depend on its position alone.

    Coordinates in the normal frame, shape (n, 3), are rounded to four decimals and hashed with the seed,
    a signed 64-bit number, so a surface gives the same draw for any order of its vertices.
    """
    key = seed.to_bytes(8, "little", signed=True)
    cells = np.rint(np.ascontiguousarray(points) * 10**4).astype("<i8")
    numbers = [
        int.from_bytes(hashlib.blake2b(cell.tobytes(), digest_size=8, key=key).digest(), "little")
        for cell in cells
    ]
    return np.array(numbers, dtype=np.uint64).astype(np.float64) / 2.0**64


def draw_scale(weights: Floats, count: int) -> float:
    """Return the c with sum min(1, c q) = count: such a draw has `count` points on average."""
    ordered = np.sort(weights[weights > 0.0])[::-1]
    if count >= len(ordered):
        return float(1.0 / ordered[-1]) if len(ordered) else 1.0
    rest = np.cumsum(ordered[::-1])[::-1]
    sure = np.arange(len(ordered))
    scale = (count - sure) / rest
    return float(scale[np.argmax(scale * ordered <= 1.0)])


def random_draw(weights: Floats, count: int, uniform: Floats) -> Ints:
    """Draw exactly `count` points with inclusion probabilities p_i = min(1, c q_i), shape (count,).

    Pareto sampling (Rosen 1997) selects the points of smallest u_i (1 - p_i) / (p_i (1 - u_i)). Poisson
    sampling keeps a point if this ratio is below 1; the fixed size changes the probabilities slightly. Every
    point with p_i = 1 is selected. The q_i are `weights` >= 0, and the u_i `uniform` in [0, 1), shapes (n,).
    """
    probability = np.minimum(1.0, draw_scale(weights, count) * weights)
    # Points of weight 0 come last, ordered by `uniform`.
    ratio = uniform * (1.0 - probability) / (np.maximum(probability, 1e-200) * (1.0 - uniform))
    return np.lexsort((uniform, ratio))[:count].astype(np.int64)


def weighted_farthest_points(
    graph: csr_array, points: Floats, weights: Floats, count: int, power: float
) -> Ints:
    """Select farthest points weighted by Lewis weights, shape (count,).

    Each sample maximises distance times (q / mean q)^power, the factor clipped to [1/4, 4]. Power 0 is plain
    farthest-point sampling; a larger power puts more samples where the Lewis weight is high and still covers
    every region. The first sample is the point farthest from the centroid. The graph is that of
    `core.graph.geodesics.farthest_points`; points, shape (n, 3), are in the normal frame; q, shape (n,), and
    the power are >= 0.
    """
    relative = np.clip((weights / weights.mean()) ** power, 0.25, 4.0)
    first = int(np.argmax(tied_ranks(np.linalg.norm(points, axis=1))))
    return farthest_points(graph, count, first, relative)
