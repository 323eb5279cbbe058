"""The paper's matching: nearest neighbours under the iterated spline, each way, in each spectral domain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Ints
from core.embedding import Embedding
from core.matching.correspondence import progressive, smoothers
from core.matching.similarity import correlation, effective_distance, effective_pairs, squared_difference
from core.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Domain:
    """The samples in one spectral domain, with their splines.

    Attributes
    ----------
    points : float64, shape (m, k)
    operators : float32, shape (k - first_dimensions + 1, m, m)
        Their spline, factored: see `core.matching.correspondence.smoothers`.
    """

    points: Floats
    operators: Float32s

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.points.nbytes + self.operators.nbytes


@dataclass(frozen=True, eq=False)
class Warped:
    """One way: the scores of the warped points and their nearest neighbours, arrays of shape (m,)."""

    scores: tuple[float, float, float]
    matches: Ints
    distances: Floats
    effective: NDArray[np.bool_]


def domains(embedding: Embedding, parameters: Parameters) -> tuple[Domain, ...]:
    """The samples of an embedding, with their splines, one a spectrum."""
    samples = int(embedding.regions.max()) + 1
    clouds = [spectrum.coordinates[:samples].astype(np.float64) for spectrum in embedding.spectra]
    return tuple(
        Domain(points, smoothers(points, parameters.matching.first_dimensions, parameters.matching.stiffness))
        for points in clouds
    )


def warped(first: Domain, second: Domain, parameters: Parameters) -> Warped:
    """The paper's comparison one way: CC, SSD, sim of the warped points and their nearest neighbours."""
    matches = np.asarray(
        progressive(
            first.points.astype(np.float32),
            second.points.astype(np.float32),
            first.operators,
            parameters.matching.first_dimensions,
            2**parameters.matching.first_dimensions if parameters.matching.sign_starts else 1,
            parameters.matching.kept_starts,
            parameters.matching.start_iterations,
            parameters.matching.step_iterations,
        )
    )
    x = first.operators[-1].astype(np.float64) @ second.points[matches]
    y = second.points[matches]
    distances = np.linalg.norm(x - y, axis=1)
    effective = effective_pairs(distances, matches, effective_distance(x, second.points))
    sim = float(effective.sum() / min(len(first.points), len(second.points)))
    return Warped((correlation(x, y), squared_difference(x, y), sim), matches, distances, effective)
