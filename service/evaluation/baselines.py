"""Baselines: other methods of shape comparison, mostly by external libraries; meshes in, distances out.

- ShapeDNA: the Laplace-Beltrami spectrum by LaPy (Reuter, Wolter, Peinecke,
  "Laplace-Beltrami spectra as Shape-DNA of surfaces and solids", Computer-Aided Design 38, 2006).
- ICP: the distance between two point clouds after the best rigid motion, by trimesh (Besl, McKay, "A method
  for registration of 3-D shapes", IEEE PAMI 14(2), 1992).
- MDS: canonical forms, geodesic distances made Euclidean by scikit-learn's SMACOF and compared by ICP (Elad,
  Kimmel, "On bending invariant signatures for surfaces", IEEE PAMI 25(10), 2003).
- D2: the distribution of distances between pairs of points (Osada, Funkhouser, Chazelle, Dobkin, "Shape
  distributions", ACM Transactions on Graphics 21(4), 2002).
- Views: the view descriptor of `core.descriptors` alone.

Descriptions raise DegenerateMeshError for a mesh without area. Libraries are imported where they are used:
two are optional, and all are slow to import.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist, pdist

from core.arrays import Bytes, Floats
from core.descriptors.views import view_descriptor, view_distance
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import farthest_points, geodesic_distances
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.mesh.subdivision import refine
from core.sampling.surface_samples import evenly_spread
from service.evaluation.pairwise_scores import Done, in_order, loaded, reason, stored

Description = NDArray[Any]
"""The description of a shape; the method determines its type and dimensions."""

EIGENVALUES = 15
"""Number of nonzero eigenvalues of ShapeDNA."""

ICP_POINTS = 500
"""Number of samples of the surface, uniform by area."""

MDS_POINTS, MDS_VERTICES = 100, 2000
"""Farthest-point samples, and vertices of the mesh after its long edges are split (for good geodesics)."""

D2_POINTS, BINS, RANGE = 1024, 64, 3.0
"""Evenly spread points, bins of the histogram, and its range in units of the mean distance."""


@dataclass(frozen=True)
class Baseline:
    """A method in two steps.

    `compare` takes a description and those of c other shapes, and returns distances, shape (c,), 0 for equal
    shapes. `library` is the optional library that the method needs.
    """

    describe: Callable[[Mesh], Description]
    compare: Callable[[Any, Sequence[Any]], Floats]
    library: str | None = None


def normal(mesh: Mesh) -> Mesh:
    """Return the cleaned mesh, centred, along its principal axes, at unit scale."""
    cleaned = clean(mesh).mesh
    return Mesh(normal_frame(cleaned).apply(cleaned.vertices), cleaned.faces)


def spectrum(mesh: Mesh) -> Floats:
    """Return eigenvalues by linear finite elements, times the area, each divided by its rank: (EIGENVALUES,).

    The first, 0, is left out. LaPy wants no face without area, and its solver's shift is a fixed number, so
    the mesh is `normal`.
    """
    from lapy import Solver, TriaMesh  # noqa: PLC0415
    from lapy.shapedna import reweight_ev  # noqa: PLC0415

    cleaned = normal(mesh)
    surface = TriaMesh(cleaned.vertices, cleaned.faces)
    values, _ = Solver(surface).eigs(k=EIGENVALUES + 1, rng=0)
    # LaPy computes the area from edge lengths, which gives NaN for slivers by rounding.
    area = float(face_areas(surface.v, surface.t).sum())
    return np.asarray(reweight_ev(area * values[1:]))


def random_points(mesh: Mesh) -> Floats:
    """Return random points of the `normal` surface, shape (ICP_POINTS, 3)."""
    from trimesh import Trimesh  # noqa: PLC0415
    from trimesh.sample import sample_surface  # noqa: PLC0415

    cleaned = normal(mesh)
    surface = Trimesh(cleaned.vertices, cleaned.faces, process=False)
    return np.asarray(sample_surface(surface, ICP_POINTS, seed=0)[0])


def registered_distances(description: Floats, others: Sequence[Floats], *, mirrored: bool = False) -> Floats:
    """Return residuals of `closest_motion` from one cloud to each of c others, shape (c,)."""
    return np.array([closest_motion(description, other, mirrored=mirrored) for other in others])


def closest_motion(points: Floats, target: Floats, *, mirrored: bool = False) -> float:
    """Return the residual of the best rigid motion: the root mean square of distances both ways.

    Both clouds, shapes (n, 3) and (m, 3), are centred and along their principal axes. The search starts from
    the four rotations that keep these axes, if `mirrored` also from the four reflections, each followed by
    trimesh's iterations; the best end counts.
    """
    from trimesh.registration import icp  # noqa: PLC0415

    tree = cKDTree(target)
    residuals: list[float] = []
    for signs in product((1.0, -1.0), repeat=3):
        if mirrored or np.prod(signs) > 0.0:
            start = np.diag([*signs, 1.0])
            _, moved, _ = icp(  # type: ignore[no-untyped-call]
                points, target, initial=start, scale=False, reflection=False
            )
            ahead, back = tree.query(moved)[0], cKDTree(moved).query(target)[0]
            residuals.append(float(np.sqrt(0.5 * ((ahead**2).mean() + (back**2).mean()))))
    return min(residuals)


def bent_form(mesh: Mesh) -> Floats:
    """Return the canonical form of farthest-point samples, shape (MDS_POINTS, 3); see `canonical_form`."""
    surface = normal(mesh)
    if len(surface.vertices) < MDS_VERTICES:
        surface = refine(surface, MDS_VERTICES)
    graph = edge_graph(surface)
    first = int(np.argmax(np.linalg.norm(surface.vertices, axis=1)))
    return canonical_form(geodesic_distances(graph, farthest_points(graph, MDS_POINTS, first)))


def canonical_form(distances: Floats) -> Floats:
    """Return points in space, shape (m, 3), whose distances approximate given ones, shape (m, m), best.

    The points are centred, along their principal axes (MDS leaves rotation and reflection undetermined), with
    unit root mean square radius. The given distances are symmetric, zero on the diagonal.
    """
    from sklearn.manifold import MDS  # noqa: PLC0415

    scaling = MDS(n_components=3, metric="precomputed", init="classical_mds", n_init=1)
    points = scaling.fit_transform(distances)
    points = points - points.mean(axis=0)
    points = points @ np.linalg.svd(points, full_matrices=False)[2].T
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))


def distance_distribution(mesh: Mesh) -> Floats:
    """Return the share of distances between points in each bin, shape (BINS,); the sum is at most 1.

    Distances are divided by their mean, so the size of the shape does not matter.
    """
    surface = clean(mesh).mesh
    areas = face_areas(surface.vertices, surface.faces)
    points, _ = evenly_spread(surface.vertices[surface.faces], areas, D2_POINTS)
    lengths = pdist(points)
    counts, _ = np.histogram(lengths / lengths.mean(), bins=BINS, range=(0.0, RANGE))
    return np.asarray(counts / len(lengths))


def views(mesh: Mesh) -> Bytes:
    """Return the view descriptor of the cleaned mesh, shape (VIEW_BYTES,)."""
    surface = clean(mesh).mesh
    return view_descriptor(surface.vertices, surface.faces)


def view_distances(description: Bytes, others: Sequence[Bytes]) -> Floats:
    """Return view distances, shape (c,)."""
    return view_distance(description, np.stack(others))


def vector_distances(metric: str, description: Floats, others: Sequence[Floats]) -> Floats:
    """Return the Euclidean or L1 ("cityblock") distances of a vector from c others, shape (c,)."""
    return np.asarray(cdist([description], others, metric)[0])


BASELINES = {
    "shapedna": Baseline(spectrum, partial(vector_distances, "euclidean"), "lapy"),
    "icp": Baseline(random_points, registered_distances),
    "mds": Baseline(bent_form, partial(registered_distances, mirrored=True), "sklearn"),
    "d2": Baseline(distance_distribution, partial(vector_distances, "cityblock")),
    "views": Baseline(views, view_distances),
}
"""Each baseline by the name that `isoshape evaluate --method` takes."""


def describe_files(pool: Executor, method: str, paths: Sequence[Path], done: Done) -> list[Description | str]:
    """Return the description of each file, or the reason why there is none."""
    return in_order(pool, partial(_describe, method), paths, done)


def distance_matrix(pool: Executor, method: str, descriptions: Sequence[Description], done: Done) -> Floats:
    """Return distances of all pairs, shape (n, n); each pair is compared once."""
    n = len(descriptions)
    distances = np.zeros((n, n))
    with stored(list(descriptions)) as path:
        for i, row in enumerate(pool.map(partial(_compare, method, path), range(n - 1))):
            distances[i, i + 1 :] = distances[i + 1 :, i] = row
            done(n - 1 - i)
    return distances


def _describe(method: str, path: Path) -> Description | str:
    try:
        return BASELINES[method].describe(read_mesh(path.read_bytes(), format_of(path.name)))
    except Exception as error:
        return reason(error)


def _compare(method: str, path: Path, i: int) -> Floats:
    descriptions: list[Description] = loaded(path)
    return BASELINES[method].compare(descriptions[i], descriptions[i + 1 :])
