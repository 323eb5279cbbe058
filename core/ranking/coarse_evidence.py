"""Coarse evidence: `core.ranking.evidence` from what is known of many shapes without their embeddings.

Signatures, view signatures and reliabilities give some differences exactly and the view distance roughly.
The others are typical ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats
from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT
from core.descriptors.view_signature import signature_distance
from core.ranking.evidence import Evidence
from core.ranking.local_density import TYPICAL_SPECTRAL, TYPICAL_VIEW

VIEW_SCALE = 1.0 / 1900.0
"""View distance over the distance of view signatures, the mean of pairs of many kinds."""

TYPICAL_SIM, TYPICAL_SPIN_IMAGES = 0.5, 2.0
"""Of shapes that are near by eigenvalues or by views."""

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


def coarse_evidence(
    query: CoarseDescriptors, others: CoarseDescriptors, cc: Floats | None = None
) -> Evidence:
    """The differences between one shape and c others, roughly.

    Parameters
    ----------
    query : CoarseDescriptors
        Of one shape.
    others : CoarseDescriptors
        Of c shapes.
    cc : float64, shape (c,), optional
        Approximate CC; typical ones for the spectral distances unless given.
    """
    count = len(others.signatures)
    steps = others.signatures.astype(np.float64) - query.signatures[0]
    views = signature_distance(query.view_signatures[0], others.view_signatures)
    spectral = np.linalg.norm(steps[:, :-GLOBAL_DESCRIPTORS], axis=1)
    typical = np.full(count, TYPICAL_SPIN_IMAGES)
    return Evidence(
        cc=1.0 - np.minimum(LEAST_DISSIMILARITY + SLOPE * spectral, 1.0) if cc is None else cc,
        sim=np.full(count, TYPICAL_SIM),
        spectral=spectral,
        global_distance=np.linalg.norm(steps[:, -GLOBAL_DESCRIPTORS:], axis=1) / GLOBAL_WEIGHT,
        spin_images=typical,
        part=np.zeros(count, dtype=bool),
        part_distance=typical,
        views=VIEW_SCALE * views.astype(np.float64),
        reliability=np.sqrt(query.reliabilities[0] * others.reliabilities.astype(np.float64)),
        spectral_density=np.full(count, TYPICAL_SPECTRAL),
        view_density=np.full(count, TYPICAL_VIEW),
    )
