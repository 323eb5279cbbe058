"""Two embeddings matched: alignment, correspondence and scores in one spectral domain."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.alignment import align, procrustes
from core.assignment import one_to_one
from core.correspondence import progressive, smoothers
from core.embedding import Float32s, Spectrum
from core.mesh import Floats, Ints
from core.parameters import Parameters
from core.similarity import correlation, effective_distance, effective_pairs, squared_difference


@dataclass(frozen=True, eq=False)
class Prepared:
    """What matching needs of one spectrum, computed once and used for every other shape.

    Attributes
    ----------
    points : float64, shape (m, k)
        Centred, unit root mean square radius.
    single : float32, shape (m, k)
        The same.
    operators : float32, shape (k - first_dimensions + 1, m, m)
        The spline, factored: see `core.correspondence.smoothers`.
    key : bytes
        A hash of the coordinates, by which a pair is put in order.
    """

    points: Floats
    single: Float32s
    operators: Float32s
    key: bytes


@dataclass(frozen=True, eq=False)
class SpectralMatch:
    """One pair in one spectral domain; fields as in `core.embedding.Match`."""

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]

    def swapped(self) -> "SpectralMatch":
        """The same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return SpectralMatch(
            self.cc,
            self.ssd,
            self.sim,
            self.pairs[order][:, ::-1],
            self.distances[order],
            self.effective[order],
        )


def prepare(spectrum: Spectrum, parameters: Parameters) -> Prepared:
    """The spectrum with its splines factored."""
    points = np.ascontiguousarray(spectrum.coordinates, dtype=np.float64)
    return Prepared(
        points=points,
        single=np.ascontiguousarray(spectrum.coordinates),
        operators=smoothers(points, parameters.first_dimensions, parameters.stiffness),
        key=hashlib.blake2b(np.ascontiguousarray(spectrum.coordinates).tobytes(), digest_size=16).digest(),
    )


def _search(first: Prepared, second: Prepared, parameters: Parameters) -> Ints:
    return np.asarray(
        progressive(
            first.single,
            second.single,
            first.operators,
            parameters.first_dimensions,
            2**parameters.first_dimensions if parameters.sign_starts else 1,
            parameters.kept_starts,
            parameters.start_iterations,
            parameters.step_iterations,
        )
    )


def _aligned(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """The better of two searches, one from each side, ended in one-to-one pairs; m <= n."""
    there, back = _search(first, second, parameters), _search(second, first, parameters)
    starts = (
        procrustes(first.points, second.points[there]),
        procrustes(first.points[back], second.points),
    )
    found = [align(first.points, second.points, start, parameters.align_rounds) for start in starts]
    cc, matches, rotation = max(found, key=lambda one: float(one[0]))
    x, y = first.points @ rotation, second.points[matches]
    distances = np.linalg.norm(x - y, axis=1)
    gamma = effective_distance(first.points, second.points)
    effective = effective_pairs(distances, matches, gamma)
    pairs = np.stack([np.arange(len(matches)), matches], axis=1)
    return SpectralMatch(
        float(cc),
        squared_difference(x, y),
        float(effective.sum() / min(len(first.points), len(second.points))),
        pairs,
        distances,
        effective,
    )


def _warped(first: Prepared, second: Prepared, parameters: Parameters) -> tuple[float, float, float, Floats]:
    """The paper's comparison one way: scores of the warped points and their nearest neighbours."""
    matches = _search(first, second, parameters)
    targets = second.points
    x = first.operators[-1].astype(np.float64) @ targets[matches]
    y = targets[matches]
    distances = np.linalg.norm(x - y, axis=1)
    effective = effective_pairs(distances, matches, effective_distance(x, targets))
    smaller = min(len(first.points), len(targets))
    return correlation(x, y), squared_difference(x, y), float(effective.sum() / smaller), x


def _nearest(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """Both ways of the paper's comparison, averaged; the pairs shown are one-to-one between warped points."""
    there = _warped(first, second, parameters)
    back = _warped(second, first, parameters)
    x, y = there[3], second.points
    cost = ((x[:, None, :] - y[None, :, :]) ** 2).sum(axis=2)
    pairs = one_to_one(cost)
    distances = np.sqrt(cost[pairs[:, 0], pairs[:, 1]])
    return SpectralMatch(
        0.5 * (there[0] + back[0]),
        0.5 * (there[1] + back[1]),
        0.5 * (there[2] + back[2]),
        pairs,
        distances,
        distances <= effective_distance(x, y),
    )


def match_spectra(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """Scores and correspondence of two clouds, the same whichever comes first.

    The pair is put in an order of its own (the smaller cloud, then the smaller hash), so that both ways round
    the same numbers are computed.
    """
    turned = (len(first.points), first.key) > (len(second.points), second.key)
    pair = (second, first) if turned else (first, second)
    compare = _aligned if parameters.pairs == "one-to-one" else _nearest
    found = compare(*pair, parameters)
    return found.swapped() if turned else found
