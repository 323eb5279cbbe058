"""Differences between one shape and several others: exact from all descriptors, or coarse from short ones.

Signatures and reliabilities give exact differences; view signatures give approximate view distances. Typical
values stand for all others, and nothing for views that a network sees.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats
from core.descriptors.partial import descriptor_distance
from core.descriptors.registry import DESCRIPTORS, ShapeDescriptors, descriptor_distances
from core.descriptors.views import VIEW_SCALE, signature_distance
from core.embedding import Scores
from core.ranking.local_density import LocalDensities, typical_densities
from core.ranking.shortlist import global_distances, spectral_distances


@dataclass(frozen=True, eq=False)
class PairDifferences:
    """Differences between one shape and c others.

    Attributes
    ----------
    cc, sim : float64, shape (c,)
        See `core.embedding.Scores`.
    spectral, global_distance : float64, shape (c,)
        Distances between the eigenvalues and between the global descriptors of two signatures, >= 0.
    distances : dict of float64, each of shape (c,)
        The distances of each descriptor, by name, >= 0, NaN where a shape lacks it: see
        `core.descriptors.registry`. That of eigenvalues is the lesser of two for shapes of one kind: see
        `core.ranking.kinds`.
    part : bool, shape (c,)
        Whether one or both surfaces are incomplete.
    part_distance : float64, shape (c,)
        Descriptor distance (`core.descriptors.partial`) of an incomplete pair, >= 0; equal to that of the
        spin images for complete surfaces.
    reliability : float64, shape (c,)
        Geometric mean of both shapes' reliabilities, in (0, 1].
    spectral_density, view_density, network_density : float64, shape (c,)
        Geometric means of both shapes' distances to their seventh neighbours, by eigenvalues, by views, and
        by views that a network sees.
    """

    cc: Floats
    sim: Floats
    spectral: Floats
    global_distance: Floats
    distances: dict[str, Floats]
    part: NDArray[np.bool_]
    part_distance: Floats
    reliability: Floats
    spectral_density: Floats
    view_density: Floats
    network_density: Floats


def differences_of(
    query: ShapeDescriptors,
    others: Sequence[ShapeDescriptors],
    scores: Scores,
    query_density: LocalDensities | None = None,
    densities: LocalDensities | None = None,
    *,
    skipped: Collection[str] = (),
) -> PairDifferences:
    """Return the differences between one shape and c others.

    The scores are those of the query with the others; `ssd` is not read. The densities of the query, arrays
    of shape (1,), and of the others, shape (c,), are typical ones unless given. Typical distances stand for
    those of the `skipped` descriptors.
    """
    query_density, densities = _or_typical(query_density, densities, len(others))
    signatures = np.stack([other.signature for other in others])
    distances = descriptor_distances(query, others, skipped)
    of_kind = query_density.kinds.distances(densities.kinds)
    distances["eigenvalues"] = np.minimum(distances["eigenvalues"], of_kind)
    between = descriptor_distance(
        query.arrays["spin_images"],
        [other.arrays["spin_images"] for other in others],
        distances["spin_images"],
    )
    return PairDifferences(
        cc=scores.cc,
        sim=scores.sim,
        spectral=spectral_distances(query.signature, signatures),
        global_distance=global_distances(query.signature, signatures),
        distances=distances,
        part=between.part,
        part_distance=between.distance,
        reliability=np.sqrt(query.reliability * np.array([other.reliability for other in others])),
        spectral_density=np.sqrt(query_density.spectral * densities.spectral),
        view_density=np.sqrt(query_density.view * densities.view),
        network_density=np.sqrt(query_density.network * densities.network),
    )


def _or_typical(
    query_density: LocalDensities | None, densities: LocalDensities | None, count: int
) -> tuple[LocalDensities, LocalDensities]:
    """Return the densities of a query and of `count` others, typical ones where they are None."""
    return (
        typical_densities(1) if query_density is None else query_density,
        typical_densities(count) if densities is None else densities,
    )


TYPICAL_SIM = 0.5
"""The typical sim of shapes that are near by eigenvalues or views."""

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
        `core.descriptors.facts.intrinsic_reliability`, in (0, 1].
    """

    signatures: NDArray[np.float32]
    view_signatures: Bytes
    reliabilities: Float32s


def coarse_differences(
    query: CoarseDescriptors,
    others: CoarseDescriptors,
    cc: Floats | None = None,
    query_density: LocalDensities | None = None,
    densities: LocalDensities | None = None,
    *,
    part: bool = False,
) -> PairDifferences:
    """Estimate differences between one shape and c others.

    CC is approximate, shape (c,), or typical for the spectral distances. Densities are those of
    `differences_of`. `part` tells whether the one shape is incomplete; the others count as complete.
    """
    count = len(others.signatures)
    query_density, densities = _or_typical(query_density, densities, count)
    views = signature_distance(query.view_signatures[0], others.view_signatures)
    spectral = spectral_distances(query.signatures[0], others.signatures)
    distances = {name: np.full(count, descriptor.typical) for name, descriptor in DESCRIPTORS.items()}
    distances["views"] = VIEW_SCALE * views.astype(np.float64)
    distances["eigenvalues"] = spectral
    distances["network_views"] = np.full(count, np.nan)
    return PairDifferences(
        cc=1.0 - np.minimum(LEAST_DISSIMILARITY + SLOPE * spectral, 1.0) if cc is None else cc,
        sim=np.full(count, TYPICAL_SIM),
        spectral=spectral,
        global_distance=global_distances(query.signatures[0], others.signatures),
        distances=distances,
        part=np.full(count, part),
        part_distance=distances["spin_images"],
        reliability=np.sqrt(query.reliabilities[0] * others.reliabilities.astype(np.float64)),
        spectral_density=np.sqrt(query_density.spectral * densities.spectral),
        view_density=np.sqrt(query_density.view * densities.view),
        network_density=np.sqrt(query_density.network * densities.network),
    )
