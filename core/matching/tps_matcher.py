"""The TPS matcher, the paper's: nearest neighbours under an iterated thin-plate spline (Eq. 17).

Its search in plain NumPy is also the reference of `core.matching.kernels.spline_search`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Int8s, Ints, Reals
from core.embedding import Embedding, Match, Scores
from core.matching.similarity import correlation, effective_distance, effective_pairs, squared_difference
from core.matching.thin_plate_spline import spline_operators
from core.parameters import Parameters


def spline_search(
    points: Reals,
    targets: Reals,
    operators: Reals,
    *,
    starts: int,
    kept_starts: int,
    start_iterations: int,
    step_iterations: int,
) -> Ints:
    """Return the correspondence from one cloud to another, dimension by dimension.

    Each start flips signs of the first coordinates, takes nearest neighbours and alternates the spline with
    them. The best starts are carried on: the spline in k + 1 dimensions is fitted to the correspondence found
    in k, which settles the sign and the order of the next coordinate (the idea of ZoomOut, Melzi et al. 2019,
    with the spline in place of the functional map).

    Parameters
    ----------
    points : float32 or float64, shape (m, k)
    targets : of the same type, shape (n, k)
    operators : of the same type, shape (stages, m, m)
        `core.matching.thin_plate_spline.spline_operators` of `points`. The search begins in k - stages + 1
        dimensions; each stage adds one.
    starts : int
        Sign changes of the first coordinates: 2^(k - stages + 1) for all, 1 for none.
    kept_starts : int
        Number of starts, best correlation first, that are carried through all stages.
    start_iterations, step_iterations : int
        Rounds of spline and nearest neighbours for each start, and after each added dimension.

    Returns
    -------
    int64, shape (m,)
        A row of `targets` for each row of `points`.
    """
    k_all = points.shape[1]
    first = k_all - len(operators) + 1
    # Every start in the first dimensions.
    started: list[tuple[float, Ints]] = []
    for start in range(starts):
        signs = np.array([-1.0 if (start >> c) & 1 else 1.0 for c in range(first)], dtype=points.dtype)
        matches = _nearest(points[:, :first] * signs, targets[:, :first])
        for _ in range(start_iterations):
            matches = _nearest(_warp(operators[0], targets[matches, :first]), targets[:, :first])
        started.append((_signless_correlation(points[:, :first], targets[matches, :first]), matches))
    # The best starts in one more dimension at a time.
    started.sort(key=lambda scored: -scored[0])
    finished: list[tuple[float, Ints]] = []
    for _, start_matches in started[:kept_starts]:
        matches = start_matches
        for stage, k in enumerate(range(first + 1, k_all + 1), start=1):
            for _ in range(step_iterations):
                matches = _nearest(_warp(operators[stage], targets[matches, :k]), targets[:, :k])
        finished.append((_signless_correlation(points, targets[matches]), matches))
    return max(finished, key=lambda scored: scored[0])[1]


def _nearest(points: Reals, targets: Reals) -> Ints:
    """Return the row of targets (n, k) nearest to each of the points (m, k); of equals, the first."""
    squares = np.zeros((len(points), len(targets)), dtype=points.dtype)
    step = np.empty_like(squares)
    for x, y in zip(points.T, np.ascontiguousarray(targets.T), strict=True):
        np.subtract(x[:, None], y[None, :], out=step)
        squares += np.square(step, out=step)
    return np.asarray(squares.argmin(axis=1))


def _warp(operator: Reals, matched: Reals) -> Reals:
    """Return operator @ matched, shape (m, k), of a symmetric operator (m, m).

    Summed row by row, in one order on every machine: the order of a matrix product hangs on the library, and
    last bits decide between neighbours that are nearly equally near.
    """
    return np.stack([(operator * column[:, None]).sum(axis=0) for column in matched.T], axis=1)


def _signless_correlation(points: Reals, targets: Reals) -> float:
    """Return the correlation of matched points, both of shape (m, k), column signs aside."""
    x, y = points.astype(np.float64), targets.astype(np.float64)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    squares = _sum(x.T**2) * _sum(y.T**2)
    return _sum(np.abs((x * y).sum(axis=0))) / float(np.sqrt(squares)) if squares > 0.0 else 0.0


def _sum(values: Floats) -> float:
    """Return the sum in the order of memory, for the reason told in `_warp`."""
    return float(np.cumsum(values)[-1])


class Domain(NamedTuple):
    """The samples in one spectral domain, shape (m, k), and their `spline_operators`."""

    points: Floats
    operators: Float32s


@dataclass(frozen=True, eq=False)
class Domains:
    """A shape as the TPS matcher reads it: m samples, its `embedding_key`, and a domain for each spectrum."""

    samples: int
    key: bytes
    domains: tuple[Domain, ...]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(domain.points.nbytes + domain.operators.nbytes for domain in self.domains)


class OneWayMatch(NamedTuple):
    """CC, SSD and sim of the warped points of one domain, with their nearest neighbours, shape (m,).

    See `core.matching.similarity.effective_pairs` for the distances and the effective pairs.
    """

    scores: tuple[float, float, float]
    matches: Ints
    distances: Floats
    effective: NDArray[np.bool_]


class TpsMatcher:
    """The matcher of the paper, section 3.4, averaged over both ways and over the spectral domains."""

    uses_match_records = False

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def prepare(self, embedding: Embedding, key: bytes) -> Domains:
        """Return the samples of an embedding in each domain, with their splines."""
        wanted = self._parameters.matching
        samples = int(embedding.regions.max()) + 1
        clouds = [spectrum.coordinates[:samples].astype(np.float64) for spectrum in embedding.spectra]
        domains = tuple(
            Domain(points, spline_operators(points, wanted.first_dimensions, wanted.stiffness))
            for points in clouds
        )
        return Domains(samples, key, domains)

    def score(self, query: Domains, candidates: Iterable[Domains]) -> Scores:
        """Return CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""
        matches = [self.match(query, candidate) for candidate in candidates]
        cc, ssd, sim = (
            np.array([getattr(match, name) for match in matches], dtype=np.float64)
            for name in ("cc", "ssd", "sim")
        )
        return Scores(cc=cc, ssd=ssd, sim=sim)

    def candidates(
        self, first: Domains, second: Domains, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], list[bool] | None]:
        """Return the pairs of `match` alone; neither orientations nor `most` are used."""
        return [self.match(first, second).correspondence.astype(np.int64)], None

    def match(
        self, first: Domains, second: Domains, orientations: tuple[Int8s, Int8s] | None = None
    ) -> Match:
        """Return the scores, and the pairs of the smaller cloud's samples in the first domain.

        Orientations are not used.
        """
        swapped = (first.samples, first.key) > (second.samples, second.key)
        x, y = (second, first) if swapped else (first, second)
        forward = [self.match_one_way(*pair) for pair in zip(x.domains, y.domains, strict=True)]
        backward = [self.match_one_way(*pair) for pair in zip(y.domains, x.domains, strict=True)]
        cc, ssd, sim = np.mean([match.scores for match in forward + backward], axis=0).tolist()
        shown = forward[0]
        pairs = np.stack([np.arange(len(shown.matches)), shown.matches], axis=1).astype(np.int32)
        match = Match(cc, ssd, sim, pairs, shown.distances.astype(np.float32), shown.effective)
        return match.swapped() if swapped else match

    def match_one_way(self, first: Domain, second: Domain) -> OneWayMatch:
        """Return the nearest neighbours of the warped samples of one domain, and their scores."""
        wanted = self._parameters.matching
        matches = spline_search(
            first.points.astype(np.float32),
            second.points.astype(np.float32),
            first.operators,
            starts=2**wanted.first_dimensions if wanted.sign_starts else 1,
            kept_starts=wanted.kept_starts,
            start_iterations=wanted.start_iterations,
            step_iterations=wanted.step_iterations,
        )
        x = first.operators[-1].astype(np.float64) @ second.points[matches]
        y = second.points[matches]
        distances = np.linalg.norm(x - y, axis=1)
        effective = effective_pairs(distances, matches, effective_distance(x, second.points))
        sim = float(effective.sum() / min(len(first.points), len(second.points)))
        scores = correlation(x, y), squared_difference(x, y), sim
        return OneWayMatch(scores, matches, distances, effective)
