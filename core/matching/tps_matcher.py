"""The TPS matcher, the paper's: nearest neighbours under the iterated spline, in each spectral domain."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Int8s, Ints
from core.embedding import Embedding, Scores
from core.matching.correspondence import spline_search
from core.matching.matcher import PairMatch
from core.matching.similarity import correlation, effective_distance, effective_pairs, squared_difference
from core.matching.spline_operators import spline_operators
from core.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Domain:
    """The samples in one spectral domain, with their splines.

    Attributes
    ----------
    points : float64, shape (m, k)
    operators : float32, shape (k - first_dimensions + 1, m, m)
        Their splines: see `core.matching.spline_operators.spline_operators`.
    """

    points: Floats
    operators: Float32s


@dataclass(frozen=True, eq=False)
class Domains:
    """A shape as the TPS matcher reads it.

    Attributes
    ----------
    samples : int
        m.
    key : bytes
        `core.matching.matcher.embedding_key`.
    domains : tuple of Domain
        One a spectrum.
    """

    samples: int
    key: bytes
    domains: tuple[Domain, ...]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(domain.points.nbytes + domain.operators.nbytes for domain in self.domains)


@dataclass(frozen=True, eq=False)
class OneWayMatch:
    """The match from one domain's samples to another's.

    Attributes
    ----------
    scores : tuple of float
        CC, SSD and sim of the warped points and their nearest neighbours.
    matches : int64, shape (m,)
    distances : float64, shape (m,)
    effective : bool, shape (m,)
        See `core.matching.similarity.effective_pairs`.
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
        """The samples of an embedding in each domain, with their splines."""
        wanted = self._parameters.matching
        samples = int(embedding.regions.max()) + 1
        clouds = [spectrum.coordinates[:samples].astype(np.float64) for spectrum in embedding.spectra]
        domains = tuple(
            Domain(points, spline_operators(points, wanted.first_dimensions, wanted.stiffness))
            for points in clouds
        )
        return Domains(samples, key, domains)

    def score(self, query: Domains, candidates: Iterable[Domains]) -> Scores:
        """CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""
        found = [self.match(query, candidate) for candidate in candidates]
        cc, ssd, sim = (
            np.array([getattr(one, name) for one in found], dtype=np.float64) for name in ("cc", "ssd", "sim")
        )
        return Scores(cc=cc, ssd=ssd, sim=sim)

    def candidates(
        self, first: Domains, second: Domains, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], bool | None]:
        """The pairs of `match` alone; neither orientations nor `most` are used."""
        return [self.match(first, second).pairs], None

    def match(
        self, first: Domains, second: Domains, orientations: tuple[Int8s, Int8s] | None = None
    ) -> PairMatch:
        """The scores, and the pairs of the smaller cloud's samples in the first domain.

        Orientations are not used.
        """
        swapped = (first.samples, first.key) > (second.samples, second.key)
        x, y = (second, first) if swapped else (first, second)
        there = [self.match_one_way(*pair) for pair in zip(x.domains, y.domains, strict=True)]
        back = [self.match_one_way(*pair) for pair in zip(y.domains, x.domains, strict=True)]
        cc, ssd, sim = np.mean([one.scores for one in there + back], axis=0).tolist()
        shown = there[0]
        pairs = np.stack([np.arange(len(shown.matches)), shown.matches], axis=1)
        found = PairMatch(cc, ssd, sim, pairs, shown.distances, shown.effective)
        return found.swapped() if swapped else found

    def match_one_way(self, first: Domain, second: Domain) -> OneWayMatch:
        """The nearest neighbours of the warped samples of one domain, and their scores."""
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
