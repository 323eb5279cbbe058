"""Noise on the vertices: how rough a surface is at the scale of its edges, and smoothing of rough ones."""

import numpy as np
from scipy.sparse import csr_array, diags_array

from core.arrays import Floats
from core.mesh.mesh import Mesh

SHRINK, GROW = 0.5, -0.53
"""Taubin's two steps: what the first takes of the coarse form the second gives back."""


def neighbour_means(mesh: Mesh) -> csr_array:
    """The matrix that takes values at the vertices to the means over each one's neighbours, shape (n, n)."""
    count = len(mesh.vertices)
    ends = np.concatenate([mesh.faces[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    links = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    links.data[:] = 1.0
    return csr_array(diags_array(1.0 / np.maximum(links.sum(axis=1), 1.0)) @ links)


def vertex_normals(mesh: Mesh) -> Floats:
    """Unit normals, each the mean of the faces' about a vertex by area, shape (n, 3); 0 where they cancel."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack(
        [
            np.bincount(mesh.faces.ravel(), np.repeat(normals[:, axis], 3), len(mesh.vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None])


def roughness(mesh: Mesh) -> float:
    """How far vertices stand out from their neighbours, in mean edge lengths.

    The median, over the vertices, of the normal part of the Laplacian (neighbours' mean less vertex) applied
    twice. A smooth surface has next to none, and a crease has it along a line only: clean scans and parts
    are under 0.07, the same simplified to a tenth, or to 250 vertices, under 0.2. Independent noise of half
    an edge's length has 0.3.
    """
    means = neighbour_means(mesh)
    once = means @ mesh.vertices - mesh.vertices
    twice = means @ once - once
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    length = float(np.linalg.norm(edges, axis=2).mean())
    return float(np.median(np.abs((twice * vertex_normals(mesh)).sum(axis=1)))) / length


def taubin_smoothing(mesh: Mesh, iterations: int) -> Mesh:
    """Taubin smoothing (1995): noise at the scale of the edges goes, the form stays as large as it is.

    Parameters
    ----------
    mesh : Mesh
        Each of its vertices in a face.
    rounds : int
        Of the two steps.
    """
    means = neighbour_means(mesh)
    points = mesh.vertices
    for _ in range(iterations):
        for step in (SHRINK, GROW):
            points = points + step * (means @ points - points)
    return Mesh(points, mesh.faces)
