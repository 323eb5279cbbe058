"""The vertices of a mesh that are embedded, by the parameters."""

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Ints
from core.errors import DegenerateMeshError
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.sampling.lewis_weights import lewis_weights
from core.sampling.sampling import keyed_uniform, random_draw, sort_and_cut, weighted_farthest_points


def embedded_points(mesh: Mesh, graph: csr_array, parameters: Parameters) -> tuple[Ints, int]:
    """The vertices that are embedded, int64, shape (d,), and the number m of samples, which come first.

    Parameters
    ----------
    mesh : Mesh
        In its normal frame, with n vertices.
    graph : csr_array, shape (n, n)
        Its edge graph.
    parameters : Parameters

    Raises
    ------
    DegenerateMeshError
        The mesh has too few vertices for the dimensions.
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
    """Least number of vertices for the samples, and for the eigenvalues of the signature.

    `core.mesh.subdivision.refine` leaves edges up to 1.5 times the even side, so it may make 2.25 times fewer
    vertices than asked.
    """
    wanted, spectral = parameters.sampling, parameters.spectral
    samples = max(spectral.dimensions + 2, spectral.affinity_values)
    asked = wanted.samples or int(np.ceil(samples / wanted.tau))
    return int(np.ceil(2.5 * max(asked, samples, spectral.laplacian_values + 2)))
