"""Kinds of nearly isometric shapes in a sample, and the metric of each, in which poses of one body are near.

A pose moves the eigenvalues of a person together, and otherwise than those of a horse. The differences
between a shape and its nearest neighbours, mostly other poses of the body, show these directions without
labels. Relevant component analysis whitens them: A. Bar-Hillel, T. Hertz, N. Shental, D. Weinshall, "Learning
a Mahalanobis metric from equivalence constraints", JMLR 6, 2005. The neighbours by the metric are more often
poses of the body, and give a better metric.

By a metric learned from poses, two poses of a body are much nearer than two bodies are. A metric learned from
other individuals would hide what tells these apart, and mostly shows no such gap: the kind then has none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from core.arrays import Bytes, Float32s, Floats, Ints
from core.descriptors.eigenvalues import TREND, eigenvalue_coordinates
from core.descriptors.views import view_distance
from core.spectral.spectral_embedding import SPECTRUM

NO_KIND = -1
"""Stands for the kind of a shape that has none."""

SAME_KIND, SAME_BODY, COPY = 0.04, 0.03, 0.002
"""Distances of eigenvalues. Shapes that a chain of steps below the first joins are one kind. A near neighbour
below the second is another pose of the body, and below the last a copy, which shows no pose."""

BENT = 0.3
"""Poses of one body look different from outside: their views differ by more than this, whereas those of two
sizes of a screw, which may be as near by eigenvalues, do not."""

NEIGHBOURS = 4
"""The largest number of neighbours of each shape that are taken for poses of its body."""

RELATIVE_DISTANCE, RISE = 0.38, 1.15
"""Neighbours are poses where their relative distance is below the first, and at most the second times the
least of fewer neighbours."""

ROUNDS = 5
"""How often the metric of a kind is found: by the nearest eigenvalues first, then by the last metric."""

POSED = 0.6
"""A kind has a metric only if at least this share of its near neighbours look different."""

FOLDS, MIXING = 3, 1e6
"""Number of folds of cross-validation. The whole part of a step's length times `MIXING`, modulo `FOLDS`, is a
pair's fold, whatever the order of the shapes."""

MESH_NOISE, MESHES = 0.004, 200
"""Standard deviation of the logarithm of eigenvalue 10 between meshes of one surface, which grows with the
root of the eigenvalue's number; and how many neighbours' differences count as much as this prior."""

SCALE = 0.01
"""Factor of whitened distances: two poses of a body then have about the distance that they have elsewhere."""


@dataclass(frozen=True, eq=False)
class KindCoordinates:
    """Coordinates of c shapes, each in the metric of its kind.

    Attributes
    ----------
    kinds : int64, shape (c,)
        Numbers of the kinds in a sample; NO_KIND for shapes without one.
    coordinates : float32, shape (c, SPECTRUM)
        Whitened log eigenvalues; 0 without a kind.
    """

    kinds: Ints
    coordinates: Float32s

    def distances(self, others: "KindCoordinates") -> Floats:
        """Return distances between these shapes, or one, and as many others, inf between two kinds."""
        steps = self.coordinates.astype(np.float64) - others.coordinates
        distances = SCALE * np.sqrt((steps**2).mean(axis=1))
        return np.where((self.kinds == others.kinds) & (self.kinds != NO_KIND), distances, np.inf)


def without_kinds(count: int) -> KindCoordinates:
    """Return the coordinates of `count` shapes without a kind."""
    return KindCoordinates(np.full(count, NO_KIND), np.zeros((count, SPECTRUM), dtype=np.float32))


@dataclass(frozen=True, eq=False)
class Kinds:
    """The kinds in a sample.

    Attributes
    ----------
    members : float64, shape (m, SPECTRUM)
        `eigenvalue_coordinates` of the shapes that have a kind.
    kinds : int64, shape (m,)
        The number of the kind of each.
    factors : float32, shape (g, SPECTRUM, SPECTRUM)
        Lower Cholesky factors of the covariance of poses, one for each kind.
    """

    members: Floats
    kinds: Ints
    factors: Float32s

    def of(self, logarithms: Floats) -> KindCoordinates:
        """Return coordinates of c shapes, from log eigenvalues of shape (c, SPECTRUM), NaN where they lack.

        A shape has the kind of the nearest member, if this is nearer than `SAME_KIND`.
        """
        found = without_kinds(len(logarithms))
        if not len(self.kinds) or not len(logarithms):
            return found
        distances = cdist(eigenvalue_coordinates(logarithms), self.members, "cityblock")
        distances[np.isnan(distances)] = np.inf
        near = distances.min(axis=1) < SAME_KIND
        found.kinds[near] = self.kinds[distances[near].argmin(axis=1)]
        for kind in np.unique(found.kinds[near]):
            rows = found.kinds == kind
            whitened = solve_triangular(self.factors[kind], logarithms[rows].T, lower=True)
            found.coordinates[rows] = whitened.T
        return found


def kinds_in(logarithms: Floats, views: Bytes) -> Kinds:
    """Return the kinds among m shapes.

    Log eigenvalues have the shape (m, SPECTRUM), NaN where they lack, and views (m, VIEW_BYTES).
    """
    known = ~np.isnan(logarithms).any(axis=1)
    logarithms, views = logarithms[known], views[known]
    coordinates = eigenvalue_coordinates(logarithms)
    # Kinds: shapes that chains of small steps join.
    distances = cdist(coordinates, coordinates, "cityblock")
    _, labels = connected_components(distances < SAME_KIND)
    # A metric for each kind with enough poses.
    factors: dict[int, Floats] = {}
    for label in np.unique(labels):
        rows = np.flatnonzero(labels == label)
        # Copies show no pose: the metric is learned from one of each.
        among = distances[np.ix_(rows, rows)]
        single = (among < COPY).argmax(axis=1) == np.arange(len(rows))
        rows, among = rows[single], among[np.ix_(single, single)]
        np.fill_diagonal(among, np.inf)
        near = np.count_nonzero(np.sort(among, axis=1)[:, :NEIGHBOURS] < SAME_BODY)
        posed = len(_poses(among, views[rows], NEIGHBOURS)[0])
        factor = _metric(logarithms[rows], views[rows], among) if posed and posed >= POSED * near else None
        if factor is not None:
            factors[label] = factor
    members: NDArray[np.bool_] = np.isin(labels, list(factors))
    return Kinds(
        coordinates[members],
        np.searchsorted(list(factors), labels[members]),
        np.array(list(factors.values()), dtype=np.float32).reshape(-1, SPECTRUM, SPECTRUM),
    )


def _poses(distances: Floats, views: Bytes, count: int) -> tuple[Ints, Ints]:
    """Return pairs of shapes that are poses of one body, by distances of shape (m, m), inf on the diagonal.

    Poses are those of the `count` nearest shapes that are near and look different.
    """
    neighbours = np.argsort(distances, axis=1, kind="stable")[:, :count]
    near = np.take_along_axis(distances, neighbours, axis=1) < SAME_BODY
    for shape in np.flatnonzero(near.any(axis=1)):
        near[shape] &= view_distance(views[shape], views[neighbours[shape]]) > BENT
    shapes, ranks = np.nonzero(near)
    return shapes, neighbours[shapes, ranks]


def _metric(logarithms: Floats, views: Bytes, distances: Floats) -> Floats | None:
    """Return the Cholesky factor of the covariance of poses of one kind, or None if they do not stand out.

    More neighbours show the covariance better, until they are others than poses: the relative distance rises.
    """
    found, least = None, np.inf
    for count in range(1, NEIGHBOURS + 1):
        factor, relative = _metric_of(count, logarithms, views, distances)
        least = min(least, relative)
        if relative > RISE * least:
            break
        if relative < RELATIVE_DISTANCE:
            found = factor
    return found


def _metric_of(count: int, logarithms: Floats, views: Bytes, distances: Floats) -> tuple[Floats, float]:
    """Return the factor of the metric that takes `count` neighbours for poses, and their relative distance.

    Each metric finds more poses of a body among the neighbours than the one before, and fewer of others.
    """
    first, second = _poses(distances, views, count)
    factor = _factor(logarithms[second] - logarithms[first])
    for _ in range(ROUNDS - 1):
        distances = _whitened_distances(logarithms, factor)
        np.fill_diagonal(distances, np.inf)
        first, second = _poses(distances, views, count)
        factor = _factor(logarithms[second] - logarithms[first])
    return factor, _relative_distance(logarithms, first, second)


def _relative_distance(logarithms: Floats, first: Ints, second: Ints) -> float:
    """Return the median distance of the pairs `first` and `second` over that of all; inf if there are none.

    Cross-validation: the metric of the pairs of other folds measures a fold. The steps between poses are
    alike for all bodies and stay short, and steps between individuals are longer.
    """
    if not len(first):
        return np.inf
    steps = logarithms[second] - logarithms[first]
    folds = (MIXING * np.abs(steps).sum(axis=1)).astype(np.int64) % FOLDS
    ratios = np.empty(len(steps))
    for fold in range(FOLDS):
        held = folds == fold
        distances = _whitened_distances(logarithms, _factor(steps[~held]))
        others = distances[np.triu_indices(len(distances), 1)]
        ratios[held] = distances[first[held], second[held]] / np.median(others)
    return float(np.median(ratios))


def _whitened_distances(logarithms: Floats, factor: Floats) -> Floats:
    """Return the distances of m shapes in a metric, shape (m, m)."""
    whitened = solve_triangular(factor, logarithms.T, lower=True).T
    return np.asarray(SCALE / np.sqrt(SPECTRUM) * cdist(whitened, whitened))


def _factor(steps: Floats) -> Floats:
    """Return the Cholesky factor of the covariance of poses, from the steps between two, shape (p, SPECTRUM).

    The prior is the noise of meshes: independent errors, and a trend of any size.
    """
    # A step is the difference of two poses, and has twice their covariance.
    prior = np.diag(MESH_NOISE**2 / 10.0 * np.arange(1, SPECTRUM + 1)) + np.outer(TREND, TREND)
    return np.linalg.cholesky((0.5 * steps.T @ steps + MESHES * prior) / (len(steps) + MESHES))
