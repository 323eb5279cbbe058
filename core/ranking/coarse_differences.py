"""Coarse differences: estimates of `core.ranking.pair_differences` from short descriptors of many shapes.

Signatures and reliabilities give exact differences; view signatures give approximate view distances. Typical
values stand for all other differences.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats
from core.descriptors.view_signature import signature_distance
from core.ranking.local_density import TYPICAL_SPECTRAL, TYPICAL_VIEW
from core.ranking.pair_differences import PairDifferences
from core.ranking.spectral_distance import global_distances, spectral_distances

VIEW_SCALE = 1.0 / 1900.0
"""View distance over the distance of view signatures, the mean of pairs of many kinds."""

TYPICAL_SIM, TYPICAL_SPIN_IMAGES = 0.5, 2.0
"""The typical sim, and the typical spin image distance, of shapes that are near by eigenvalues or views."""

LEAST_DISSIMILARITY, SLOPE = 0.02, 0.15
"""1 - CC of shapes with equal eigenvalues, and its typical growth with the spectral distance."""


@dataclass(frozen=True, eq=False)
class CoarseDescriptors:
    """Short descriptors of c shapes.

    Attributes
    ----------
    signatures : float32, shape (c, s)
    view_signatures : uint8, shape (c, SIGNATURE_BYTES)
    reliabilities : float32, shape (c,)
        `core.descriptors.reliability.intrinsic_reliability`, in (0, 1].
    """

    signatures: NDArray[np.float32]
    view_signatures: Bytes
    reliabilities: Float32s


def coarse_differences(
    query: CoarseDescriptors, others: CoarseDescriptors, cc: Floats | None = None, *, part: bool = False
) -> PairDifferences:
    """Approximate differences between one shape and c others.

    Parameters
    ----------
    query : CoarseDescriptors
        Of one shape.
    others : CoarseDescriptors
        Of c shapes.
    cc : float64, shape (c,), optional
        Approximate CC; typical ones for the spectral distances unless given.
    part : bool
        Whether the one shape is incomplete; the others count as complete.
    """
    count = len(others.signatures)
    views = signature_distance(query.view_signatures[0], others.view_signatures)
    spectral = spectral_distances(query.signatures[0], others.signatures)
    typical = np.full(count, TYPICAL_SPIN_IMAGES)
    return PairDifferences(
        cc=1.0 - np.minimum(LEAST_DISSIMILARITY + SLOPE * spectral, 1.0) if cc is None else cc,
        sim=np.full(count, TYPICAL_SIM),
        spectral=spectral,
        global_distance=global_distances(query.signatures[0], others.signatures),
        spin_images=typical,
        part=np.full(count, part),
        part_distance=typical,
        views=VIEW_SCALE * views.astype(np.float64),
        reliability=np.sqrt(query.reliabilities[0] * others.reliabilities.astype(np.float64)),
        spectral_density=np.full(count, TYPICAL_SPECTRAL),
        view_density=np.full(count, TYPICAL_VIEW),
    )
