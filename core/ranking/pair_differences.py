"""Differences between one shape and several others, from all descriptors of their embeddings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Floats
from core.descriptors.descriptor_distance import descriptor_distance, whole_spin_images
from core.descriptors.reliability import intrinsic_reliability
from core.descriptors.spin_images import spin_image_distances
from core.descriptors.view_descriptor import view_distance
from core.embedding import Embedding, Scores
from core.ranking.local_density import LocalDensities, typical_densities
from core.ranking.spectral_distance import global_distances, spectral_distances


@dataclass(frozen=True, eq=False)
class ShapeDescriptors:
    """The parts of an embedding that are compared beside its spectra.

    Attributes
    ----------
    signature : float32, shape (s,)
    spin_images : uint8, shape (r, w)
    views : uint8, shape (v,)
    reliability : float
        `core.descriptors.reliability.intrinsic_reliability`, in (0, 1].
    """

    signature: NDArray[np.float32]
    spin_images: Bytes
    views: Bytes
    reliability: float


def descriptors_of(embedding: Embedding) -> ShapeDescriptors:
    """The descriptors of an embedding that has spin images and views."""
    return ShapeDescriptors(
        embedding.signature,
        embedding.spin_images,
        embedding.views,
        intrinsic_reliability(embedding.facts),
    )


@dataclass(frozen=True, eq=False)
class PairDifferences:
    """Differences between one shape and c others.

    Attributes
    ----------
    cc, sim : float64, shape (c,)
        See `core.embedding.Scores`.
    spectral, global_distance : float64, shape (c,)
        Distances between the eigenvalues and between the global descriptors of two signatures, >= 0.
    spin_images : float64, shape (c,)
        The larger of the two one-sided distances between the spin images of the whole surfaces, >= 0.
    part : bool, shape (c,)
        Whether one or both surfaces are incomplete.
    part_distance : float64, shape (c,)
        Descriptor distance (`core.descriptors.descriptor_distance`) of an incomplete pair, >= 0; equal to
        `spin_images` for complete surfaces.
    views : float64, shape (c,)
        View distances, >= 0.
    reliability : float64, shape (c,)
        Geometric mean of both shapes' reliabilities, in (0, 1].
    spectral_density, view_density : float64, shape (c,)
        Geometric means of both shapes' distances to their seventh neighbours, by eigenvalues and by views.
    """

    cc: Floats
    sim: Floats
    spectral: Floats
    global_distance: Floats
    spin_images: Floats
    part: NDArray[np.bool_]
    part_distance: Floats
    views: Floats
    reliability: Floats
    spectral_density: Floats
    view_density: Floats


def differences_of(
    query: ShapeDescriptors,
    others: Sequence[ShapeDescriptors],
    scores: Scores,
    own: LocalDensities | None = None,
    densities: LocalDensities | None = None,
) -> PairDifferences:
    """The differences between one shape and c others.

    Parameters
    ----------
    query : ShapeDescriptors
    others : sequence of ShapeDescriptors
    scores : Scores
        Of the query with the others; `ssd` is not read.
    own, densities : LocalDensities, optional
        Of the query, arrays of shape (1,), and of the others, shape (c,); typical ones unless given.
    """
    own = typical_densities(1) if own is None else own
    densities = typical_densities(len(others)) if densities is None else densities
    signatures = np.stack([other.signature for other in others])
    between = descriptor_distance(query.spin_images, [other.spin_images for other in others])
    whole = between.distance.copy()
    whole[between.part] = spin_image_distances(
        whole_spin_images(query.spin_images),
        [whole_spin_images(others[place].spin_images) for place in np.flatnonzero(between.part).tolist()],
    ).max(axis=1)
    return PairDifferences(
        cc=scores.cc,
        sim=scores.sim,
        spectral=spectral_distances(query.signature, signatures),
        global_distance=global_distances(query.signature, signatures),
        spin_images=whole,
        part=between.part,
        part_distance=between.distance,
        views=view_distance(query.views, np.stack([other.views for other in others])),
        reliability=np.sqrt(query.reliability * np.array([other.reliability for other in others])),
        spectral_density=np.sqrt(own.spectral * densities.spectral),
        view_density=np.sqrt(own.view * densities.view),
    )
