"""The largest local deviation of two registered surfaces, relative to the sampling errors of both.

Two tessellations of one surface differ by their chord errors. A deviation beyond these errors is a difference
of the surfaces: of a few probes, or, smaller, of a whole smooth region such as the wall of a hole.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.registration.probed_surface import SPREAD, ProbedSurface
from core.registration.similarity import Similarity
from core.registration.surface_fit import CURVED, FARTHEST, PRECISION

OUTLIERS = 3
"""Rank of the deviation that counts as the largest: a single probe may lie on a flaw of the mesh."""

REGION_PROBES = 6
"""Least number of probes of a region whose mean deviation counts."""

REGION = 1.15
"""Root mean square deviation of a region over its expected standard deviation, above which sampling does not
explain it."""


@dataclass(frozen=True, eq=False)
class LocalDeviation:
    """The deviation of two surfaces after registration.

    Attributes
    ----------
    within : bool
        Whether sampling explains the deviation, so that the surfaces are equal.
    largest : float
        The largest distance between the surfaces, in both directions, in units of the root of the area.
    share : float
        Share of the probes that deviate.
    residual : float
        Root mean square distance of the probes that do not deviate.
    rms : float
        Root mean square distance of the probes that are spread by area.
    points : float64, shape (k, 3)
        The probes that deviate, on the first surface at unit area, the farthest first.
    """

    within: bool
    largest: float
    share: float
    residual: float
    rms: float
    points: Floats


def local_deviation(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> LocalDeviation:
    """The deviation under a transform of the first surface onto the second, both at unit area."""
    back = Similarity(
        1.0 / motion.scale, motion.rotation.T, -(motion.rotation.T @ motion.shift) / motion.scale
    )
    ahead, ahead_spans, ahead_regions = _one_way(first, second, motion)
    behind, behind_spans, behind_regions = _one_way(second, first, back)
    gaps, spans = np.concatenate([ahead, behind]), np.concatenate([ahead_spans, behind_spans])
    regions = np.concatenate([ahead_regions, behind_regions])
    points = np.concatenate([first.points, back.apply(second.points)])
    excess = gaps / (PRECISION + FARTHEST * spans)
    far = regions | (excess > 1.0)
    order = np.flatnonzero(far)[np.argsort(-gaps[far], kind="stable")]
    worst = np.partition(excess, -OUTLIERS)[-OUTLIERS]
    return LocalDeviation(
        within=bool(worst <= 1.0 and not regions.any()),
        largest=float(gaps[order[0]] if len(order) else gaps.max()),
        share=float(far.mean()),
        residual=float(np.sqrt((gaps[~far] ** 2).mean())) if not far.all() else float(gaps.max()),
        rms=float(np.sqrt(0.5 * (ahead[-SPREAD:] ** 2).mean() + 0.5 * (behind[-SPREAD:] ** 2).mean())),
        points=points[order],
    )


def _one_way(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Distances of the probes, the chord errors of both meshes, and which probes lie in deviating regions."""
    moved = motion.apply(first.points)
    targets, _, errors = second.curved.at(*second.curved.closest(moved))
    gaps = np.linalg.norm(targets - moved, axis=1)
    spans = first.errors + errors
    region = first.curved.regions[first.faces]
    count = np.maximum(np.bincount(region), 1)
    deviation = np.sqrt(np.bincount(region, gaps**2) / count)
    expected = PRECISION + CURVED * np.sqrt(np.bincount(region, spans**2) / count)
    deviating = (count >= REGION_PROBES) & (deviation > REGION * expected)
    return gaps, spans, deviating[region] & (gaps > PRECISION + CURVED * spans)
