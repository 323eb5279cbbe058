"""The alignment of two rigid parts that are neither copies nor variants, so that their differences are seen.

The matched samples give one alignment, surfaces that coincide in large part another; both are refined on the
surfaces, and the one counts that leaves them nearer.
"""

from typing import NamedTuple, Self

import numpy as np

from core.arrays import Floats
from core.registration.initial_alignments import FAR
from core.registration.probed_surface import ProbedSurface
from core.registration.similarity import NEAR, SHARE, Similarity, near_rigid, to_unit_area, trimmed_similarity
from core.registration.surface_fit import coarsely_fitted, fitted, spread_distances


def rigid_alignment(
    first: ProbedSurface, second: ProbedSurface, pairs: tuple[Floats, Floats], bent: float
) -> Similarity | None:
    """Return the transform of the first surface onto the second, in the coordinates of their files.

    Parameters
    ----------
    first, second : ProbedSurface
    pairs : two of float64, shape (m, 3)
        Corresponding points of both surfaces, in the units of their files.
    bent : float
        Matched samples that keep less than this distance (`trimmed_similarity`), over the root of the area,
        are those of rigid parts.

    Returns
    -------
    Similarity or None
        None for bodies that bend, unless `SHARE` of either surface lies on the other.
    """
    units = to_unit_area(first.samples), to_unit_area(second.samples)
    matched, distance = trimmed_similarity(units[0].apply(pairs[0]), units[1].apply(pairs[1]))
    coinciding = near_rigid(first.samples, second.samples, pairs, first.samples.unit / second.samples.unit)
    starts = [start for start in (coinciding, matched) if start is not None]
    fits = [
        _Fit.of(first, second, motion)
        for start in starts
        for motion in (start, _refined(first, second, start))
    ]
    rigid = [fit for fit in fits if distance < bent or fit.share >= SHARE]
    if not rigid:
        return None
    best = min(rigid, key=lambda fit: fit.distance)
    return units[0].then(best.motion).then(units[1].inverse)


def _refined(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> Similarity:
    return fitted(first, second, coarsely_fitted(first, second, motion)[0])


class _Fit(NamedTuple):
    """A transform at unit area, with what it leaves of the points that are spread over both surfaces.

    `distance` is the mean from the other surface, of at most `FAR` each, and `share` that of the points that
    lie within `NEAR` of it, on the surface with fewer.
    """

    motion: Similarity
    distance: float
    share: float

    @classmethod
    def of(cls, first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> Self:
        ways = spread_distances(first, second, motion)
        return cls(
            motion,
            float(np.minimum(np.concatenate(ways), FAR).mean()),
            min(float((gaps <= NEAR).mean()) for gaps in ways),
        )
