"""Canonical forms: geodesic distances made Euclidean by multidimensional scaling, then compared rigidly.

A. Elad, R. Kimmel, "On bending invariant signatures for surfaces", IEEE PAMI 25(10), 2003, with
scikit-learn's SMACOF for the scaling and iterative closest points for the comparison.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.manifold import MDS

from core.graph.edge_graph import edge_graph
from core.graph.geodesics import farthest_points, geodesic_distances
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.mesh.subdivision import refine
from service.studies.baselines.icp import closest_motion

Floats = NDArray[np.float64]

POINTS = 100
"""Number of farthest-point samples of a shape."""

VERTICES = 2000
"""Vertices of the mesh after its long edges are split, so that paths approximate geodesics."""


def describe(mesh: Mesh) -> Floats:
    """The canonical form of farthest-point samples, shape (POINTS, 3); see `canonical_form`."""
    cleaned = clean(mesh).mesh
    normal = Mesh(normal_frame(cleaned).apply(cleaned.vertices), cleaned.faces)
    surface = refine(normal, VERTICES) if len(normal.vertices) < VERTICES else normal
    graph = edge_graph(surface)
    first = int(np.argmax(np.linalg.norm(surface.vertices, axis=1)))
    return canonical_form(geodesic_distances(graph, farthest_points(graph, POINTS, first)))


def canonical_form(distances: Floats) -> Floats:
    """Points in space whose distances approximate the given distances best.

    Parameters
    ----------
    distances : float64, shape (m, m)
        Symmetric, zero on the diagonal.

    Returns
    -------
    float64, shape (m, 3)
        Centred points along their principal axes, with unit root mean square radius.
    """
    scaling = MDS(n_components=3, metric="precomputed", init="classical_mds", n_init=1)
    points = scaling.fit_transform(distances)
    points = points - points.mean(axis=0)
    points = points @ np.linalg.svd(points, full_matrices=False)[2].T
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))


def compare(description: Floats, others: Sequence[Floats]) -> Floats:
    """Distances after the best rigid motion or reflection: shape (c,). MDS leaves both undetermined."""
    return np.array([closest_motion(description, other, mirrored=True) for other in others])
