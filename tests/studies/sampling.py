"""How vertices are sampled: the paper's Figs. 2 and 3 by several selections of samples.

    python -m tests.studies.sampling DIR [--collection COLLECTION] [--limit 4]

fit.csv has the error of the best polynomial by degree (Fig. 2). samples.csv has for each selection the
change of the histogram of geodesic distances over the sparse ratio (Fig. 3a), gaps, evenness, the fit and the
rebuilt surface (Fig. 3b), and the change under noise (Fig. 3c). poses.csv has the change between poses of one
body and between shapes. A shape takes about ten seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.sparse import csc_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.special import ndtri

from core.arrays import Floats, Ints
from core.gallery import CLASSES, make_shape
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import farthest_points
from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame
from core.parameters import DEFAULT
from core.sampling.lewis_weights import lewis_weights, orthonormal_basis, polynomial_basis
from core.sampling.sampling import (
    draw_scale,
    keyed_uniform,
    random_draw,
    sort_and_cut,
    weighted_farthest_points,
)
from core.sparse_embedding import prepared
from core.spectral.laplace_beltrami import laplacian
from service.evaluation.retrieval import collection_files
from tests.people import make_person
from tests.studies.common import Panel, grid, run, save, write

PARAMETERS = DEFAULT.with_values(
    name="sampling study",
    mesh={"decimate_above": 4000, "decimate_to": 3000, "decimate_pieces_above": 0, "refine_simplified": 0},
)
"""The default parameters, but large meshes are simplified, since all pairwise distances are used."""

BINS = 5
"""Number of bins of the histogram of normalised geodesic distances (Fig. 3)."""

REGIONS = 50
"""Number of regions of about equal size in which samples are counted."""

DEGREES = (4, 5, 6)
TAUS = (0.1, 0.2, 0.5)
COMPARED, ROBUST = 0.1, 0.3
"""Sparse ratios at which selections are compared, and at which noise and poses are."""

DELTAS = (0.0015, 0.005, 0.01)
"""Deviations of the noise, over the diagonal of the bounding box in the normal frame."""

SELECTIONS = (
    *("cut printed", "cut", "draw printed", "draw", "covering printed", "covering"),
    *("poisson-disk", "farthest-point"),
)
"""By Lewis weights: cut (the paper's, the largest), drawn, and weighted farthest points, with the terms of
Eqs. 11 and 12 as printed or normalised; and two others without weights."""

POSES = 4

HALVINGS = 40
"""Steps of bisection for the radius of a Poisson-disk set."""


def distance_histogram(distances: Floats) -> Floats:
    """Return the paper's r: shares of pairwise distances (m, m) over the largest one in equal bins,
    (BINS,)."""
    pairs = distances[np.triu_indices(len(distances), 1)]
    counts, _ = np.histogram(pairs / pairs.max(), bins=BINS, range=(0.0, 1.0))
    return np.asarray(counts / len(pairs))


def total_variation(first: Floats, second: Floats) -> float:
    """Return half the sum of absolute differences of two distributions, in [0, 1]."""
    return 0.5 * float(np.abs(first - second).sum())


def largest_variation(histograms: Sequence[Floats]) -> float:
    """Return the largest total variation distance between two of the histograms."""
    return max((total_variation(a, b) for a, b in combinations(histograms, 2)), default=0.0)


def fit_residuals(
    points: Floats, degree: int, samples: Ints | None = None, probability: Floats | None = None
) -> Floats:
    """Return residuals z - f(x, y) of the least-squares polynomial (Eqs. 6-9) at all n points, shape (n,).

    f is fitted to the samples, or to all points. Rows of samples drawn with a probability p, shape (n,), have
    weight 1 / p, as by the matrix S of Algorithm 1, and the expected fit is that of all points.
    """
    basis = orthonormal_basis(polynomial_basis(points[:, 0], points[:, 1], degree))
    if samples is None:
        return np.asarray(points[:, 2] - basis @ (basis.T @ points[:, 2]))
    rows, heights = basis[samples], points[samples, 2]
    if probability is not None:
        root = 1.0 / np.sqrt(probability[samples])
        rows, heights = rows * root[:, None], heights * root
    return np.asarray(points[:, 2] - basis @ np.linalg.lstsq(rows, heights, rcond=None)[0])


def root_mean_square(values: Floats) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def coverage(distances: Floats, areas: Floats, samples: Ints) -> tuple[float, float, float]:
    """Return the largest gap, the mean gap by area, and the evenness of m >= 2 samples.

    A gap is the distance from a vertex to the nearest sample; evenness is the smallest distance between two
    samples over the mean distance from a sample to the next, in [0, 1].
    """
    gaps = distances[samples].min(axis=0)
    between = distances[np.ix_(samples, samples)].copy()
    np.fill_diagonal(between, np.inf)
    nearest = between.min(axis=1)
    evenness = float(nearest.min() / nearest.mean())
    return float(gaps.max()), float(areas @ gaps / areas.sum()), evenness


def rebuilt_error(stiffness: csc_array, areas: Floats, points: Floats, samples: Ints) -> float:
    """Return the error of the harmonic surface through the samples: root mean square distance by area.

    Samples are fixed, all other vertices minimise Dirichlet energy. Planar parts are reproduced exactly.
    """
    free = np.ones(len(points), dtype=bool)
    free[samples] = False
    film = points.copy()
    if free.any():
        rows = csc_array(stiffness[free])
        film[free] = splu(csc_array(rows[:, free])).solve(-(rows[:, samples] @ points[samples]))
    return float(np.sqrt(areas @ ((film - points) ** 2).sum(axis=1) / areas.sum()))


def poisson_disk(distances: Floats, count: int, order: Ints) -> tuple[Ints, float]:
    """Return a Poisson-disk set of `count` of n points, and its radius, by dart throwing (Cook 1986).

    Darts are the points in the given order; one nearer than the radius to an earlier sample is rejected. The
    radius is found by bisection; if none gives the exact number, the last few samples are left out.
    """
    low, high, samples = 0.0, 2.0 * float(distances.max()), order
    for _ in range(HALVINGS):
        radius = 0.5 * (low + high)
        free, thrown = np.ones(len(distances), dtype=bool), []
        for dart in order:
            if free[dart]:
                thrown.append(dart)
                free &= distances[dart] >= radius
        if len(thrown) < count:
            high = radius
        else:
            low, samples = radius, np.array(thrown)
        if len(thrown) == count:
            break
    return samples[:count].astype(np.int64), low


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh of n vertices in its normal frame and scale, and the cleaned mesh before that.

    `distances` are geodesic, along the graph, shape (n, n); the cotangent Laplacian has `stiffness`, shape
    (n, n), and `areas`, shape (n,); `weights` are Lewis weights, shape (n,), "printed" and normalised ("").
    """

    mesh: Mesh
    cleaned: Mesh
    frame: NormalFrame
    distances: Floats
    stiffness: csc_array
    areas: Floats
    weights: dict[str, Floats]

    @classmethod
    def of(cls, mesh: Mesh) -> "Surface":
        """Clean a mesh and put it in its normal frame."""
        normal, cleaned, frame, _ = prepared(mesh, PARAMETERS)
        lengths, sampling = np.asarray(dijkstra(edge_graph(normal))), PARAMETERS.sampling
        random = keyed_uniform(normal.vertices, sampling.seed + 1)
        weights = partial(
            lewis_weights, normal.vertices, degree=sampling.degree, epsilon=sampling.epsilon, random=random
        )
        by_terms = {terms: weights(normalise=not terms).weights for terms in ("", "printed")}
        shortest = np.minimum(lengths, lengths.T)
        return cls(normal, cleaned.mesh, frame, shortest, *laplacian(normal), by_terms)

    def select(self, selection: str, tau: float) -> Ints:
        """Return the samples of one of `SELECTIONS` at a sparse ratio, shape (tau n,); repeatable."""
        points, count = self.mesh.vertices, round(tau * len(self.mesh.vertices))
        uniform = keyed_uniform(points, PARAMETERS.sampling.seed)
        way, _, terms = selection.partition(" ")
        weights = self.weights[terms]
        match way:
            case "poisson-disk":
                return poisson_disk(self.distances, count, np.argsort(uniform))[0]
            case "farthest-point":
                return self.farthest(count)
            case "cut":
                return sort_and_cut(weights, count)
            case "draw":
                return random_draw(weights, count, uniform)
        power = PARAMETERS.sampling.coverage_power
        return weighted_farthest_points(edge_graph(self.mesh), points, weights, count, power)

    def farthest(self, count: int) -> Ints:
        """Return farthest points, the first of them the farthest from the centre, shape (count,)."""
        first = int(np.argmax((self.mesh.vertices**2).sum(axis=1)))
        return farthest_points(edge_graph(self.mesh), count, first)

    def histogram(self, samples: Ints) -> Floats:
        """Return the histogram of distances between samples, shape (BINS,)."""
        return distance_histogram(self.distances[np.ix_(samples, samples)])

    def noisy(self, delta: float) -> "Surface":
        """Return the cleaned mesh with Gaussian noise of `delta` times its size, by the positions of
        vertices."""
        vertices = self.frame.apply(self.cleaned.vertices)
        size = float(np.linalg.norm(np.ptp(vertices, axis=0))) * self.frame.scale
        uniform = np.stack([keyed_uniform(vertices, axis) for axis in range(3)], axis=1)
        shift = delta * size * ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12))
        return Surface.of(Mesh(self.cleaned.vertices + shift, self.cleaned.faces))

    def kept(self, samples: Ints, noisy: "Surface", noisy_samples: Ints) -> float:
        """Return the share of samples in the same of `REGIONS` regions with and without noise."""
        regions = np.argmin(self.distances[self.farthest(REGIONS)], axis=0)
        positions = self.frame.apply(noisy.frame.invert(noisy.mesh.vertices[noisy_samples]))
        nearest = np.asarray(cKDTree(self.mesh.vertices).query(positions)[1])
        first, second = (
            np.bincount(regions[chosen], minlength=REGIONS) / len(chosen) for chosen in (samples, nearest)
        )
        return 1.0 - total_variation(first, second)


def measures(surface: Surface, noisy: dict[float, Surface], selection: str) -> dict[str, float]:
    """Return all measures of one selection on one surface."""
    points = surface.mesh.vertices
    steady = [surface.histogram(surface.select(selection, tau)) for tau in TAUS]
    chosen = surface.select(selection, COMPARED)
    gap, mean_gap, evenness = coverage(surface.distances, surface.areas, chosen)
    probability = None
    if selection.startswith("draw"):
        weights = surface.weights[selection.partition(" ")[2]]
        probability = np.minimum(1.0, draw_scale(weights, len(chosen)) * weights)
    degree = PARAMETERS.sampling.degree
    figures = {"change_between_taus": largest_variation(steady), "largest_gap": gap, "mean_gap": mean_gap}
    figures |= {
        "evenness": evenness,
        "fit_error": root_mean_square(fit_residuals(points, degree, chosen, probability)),
        "rebuilt_error": rebuilt_error(surface.stiffness, surface.areas, points, chosen),
    }
    robust = surface.select(selection, ROBUST)
    for delta, disturbed in noisy.items():
        again = disturbed.select(selection, min(1.0, len(robust) / len(disturbed.mesh.vertices)))
        change = total_variation(surface.histogram(robust), disturbed.histogram(again))
        figures[f"change_noise_{delta:g}"] = change
        figures[f"kept_noise_{delta:g}"] = surface.kept(robust, disturbed, again)
    return figures


def change_between(surfaces: Sequence[Surface], selection: str) -> float:
    """Return the mean change of the histogram between all pairs of surfaces."""
    histograms = [surface.histogram(surface.select(selection, ROBUST)) for surface in surfaces]
    return float(np.mean([total_variation(a, b) for a, b in combinations(histograms, 2)]))


def pictures(surface: Surface) -> tuple[Figure, Figure]:
    """Draw the samples of every selection, and the residuals of the fit by degree."""
    mesh, points = surface.mesh, surface.mesh.vertices
    panels = []
    for selection in SELECTIONS:
        samples = surface.select(selection, COMPARED)
        panels.append(Panel(mesh, selection, points[samples], np.full(len(samples), 0.62)))
    residuals = {degree: np.abs(fit_residuals(points, degree)) for degree in DEGREES}
    largest = float(np.quantile(residuals[DEGREES[0]], 0.98)) or 1.0
    painted = []
    for degree, residual in residuals.items():
        colours = 1.0 - np.minimum(residual / largest, 1.0)[:, None] * [0.1, 0.7, 0.8]
        painted.append(Panel(mesh, f"degree {degree}", painted=colours))
    return grid([panels[:4], panels[4:]]), grid([painted])


def main(folder: Path, collection: Path | None, limit: int) -> None:
    """Write fit.csv, samples.csv and poses.csv, and pictures of the first surface."""
    if collection is None:
        shapes = {label: Surface.of(make_shape(label, 0)) for label in CLASSES[:limit]}
    else:
        files = [path for path, _ in collection_files(collection, limit)]
        shapes = {path.name: Surface.of(read_mesh(path.read_bytes(), format_of(path.name))) for path in files}
    poses = [Surface.of(make_person(0, pose)) for pose in range(POSES)]
    fits: list[dict[str, Any]] = []
    for name, surface in shapes.items():
        points = surface.mesh.vertices
        errors = {f"degree_{degree}": root_mean_square(fit_residuals(points, degree)) for degree in DEGREES}
        fits.append({"shape": name, "vertices": len(points)} | errors)
    write(folder / "fit.csv", fits)
    noisy = {name: {delta: surface.noisy(delta) for delta in DELTAS} for name, surface in shapes.items()}
    rows: list[dict[str, Any]] = []
    between: list[dict[str, Any]] = []
    for selection in SELECTIONS:
        figures = [measures(surface, noisy[name], selection) for name, surface in shapes.items()]
        means = {name: float(np.mean([each[name] for each in figures])) for name in figures[0]}
        rows.append({"selection": selection} | means)
        change = change_between(list(shapes.values()), selection) if len(shapes) > 1 else ""
        between.append({"selection": selection, "poses": change_between(poses, selection), "shapes": change})
    write(folder / "samples.csv", rows)
    write(folder / "poses.csv", between)
    samples, fit = pictures(next(iter(shapes.values())))
    save(samples, folder / "sampling-samples.png")
    save(fit, folder / "sampling-fit.png")


if __name__ == "__main__":
    run(main, __doc__, collection=Path, limit=len(CLASSES))
