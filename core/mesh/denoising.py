"""Denoising: the roughness of a surface at the scale of its edges, and Taubin smoothing."""

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.edges import edge_lengths
from core.mesh.face_normals import face_normals
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, constant

SHRINK, GROW = 0.5, -0.53
"""Taubin's lambda and mu: the second step undoes the shrinkage of low frequencies by the first."""


def neighbour_means(edges: Ints, values: Floats) -> Floats:
    """Means of vertex values over the neighbours of each vertex, shape (n, 3); 0 without neighbours.

    Parameters
    ----------
    edges : int64, shape (e, 2)
        The distinct edges.
    values : float64, shape (n, 3)
    """
    return _means(edges, constant(values))


@compiled
def _means(edges: Ints, values: Floats) -> Floats:
    counts = np.zeros(len(values))
    for edge in range(len(edges)):
        counts[edges[edge, 0]] += 1.0
        counts[edges[edge, 1]] += 1.0
    shares = 1.0 / np.maximum(counts, 1.0)
    means = np.zeros((len(values), 3))
    for edge in range(len(edges)):
        one, other = edges[edge, 0], edges[edge, 1]
        for axis in range(3):
            means[one, axis] += shares[one] * values[other, axis]
            means[other, axis] += shares[other] * values[one, axis]
    return means


def vertex_normals(mesh: Mesh) -> Floats:
    """Area-weighted unit vertex normals, shape (n, 3); 0 where the normals of the faces cancel."""
    normals = face_normals(mesh.vertices[mesh.faces], unit=False)
    sums = np.stack(
        [
            np.bincount(mesh.faces.ravel(), np.repeat(normals[:, axis], 3), len(mesh.vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None])


def roughness(mesh: Mesh) -> float:
    """Median normal part of the squared umbrella Laplacian over the vertices, in mean edge lengths; >= 0.

    The umbrella Laplacian is the mean of a vertex's neighbours minus the vertex. It is small on a smooth
    surface, and large on a crease along a line only. Clean scans and CAD parts are below 0.07; the same
    meshes simplified to a tenth, or to 250 vertices, below 0.2; independent noise of half an edge gives 0.3.
    """
    links = mesh.half_edges.edges
    once = neighbour_means(links, mesh.vertices) - mesh.vertices
    twice = neighbour_means(links, once) - once
    sides = np.stack([mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()], axis=1)
    length = float(edge_lengths(mesh.vertices, sides).mean())
    return float(np.median(np.abs((twice * vertex_normals(mesh)).sum(axis=1)))) / length


def taubin_smoothing(mesh: Mesh, iterations: int) -> Mesh:
    """Taubin smoothing (1995): removes noise at the scale of the edges without shrinking the shape.

    Parameters
    ----------
    mesh : Mesh
        Every vertex belongs to a face.
    iterations : int
        Number of pairs of steps, >= 0.
    """
    links = mesh.half_edges.edges
    points = mesh.vertices
    for _ in range(iterations):
        for step in (SHRINK, GROW):
            points = points + step * (neighbour_means(links, points) - points)
    return Mesh(points, mesh.faces)
