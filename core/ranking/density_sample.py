"""Local density among many shapes: the distances to the seventh neighbours in a sample of them.

A sample of a few hundred shapes has the density of the collections that the class probability is calibrated
on, whatever the number of stored shapes, and is compared in milliseconds.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from core.arrays import Bytes, Floats
from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS
from core.descriptors.view_bytes import VIEW_BYTES
from core.descriptors.view_descriptor import view_distance
from core.descriptors.view_signature import SIGNATURE_BYTES, signature_distance, view_signature
from core.ranking.local_density import (
    TYPICAL_SPECTRAL,
    TYPICAL_VIEW,
    LocalDensities,
    neighbour_distances,
    typical_densities,
)
from core.ranking.pair_differences import ShapeDescriptors
from core.ranking.shortlist import least

NEAR_VIEWS = 16
"""Number of shapes, the nearest by view signature, whose view distances are computed: the seventh nearest by
view distance is mostly among them."""

UNMEASURED = 1e9
"""Stands for the view distances of all other shapes, which are larger."""


@dataclass(frozen=True, eq=False)
class DensitySample:
    """A sample of stored shapes, among which neighbours are searched.

    Attributes
    ----------
    eigenvalues : float64, shape (m, e)
        The part of their signatures without global descriptors.
    view_signatures : uint8, shape (m, SIGNATURE_BYTES)
    views : uint8, shape (m, VIEW_BYTES)
    """

    eigenvalues: Floats
    view_signatures: Bytes
    views: Bytes


def density_sample(shapes: list[ShapeDescriptors]) -> DensitySample:
    """The sample of some shapes, in their order."""
    signatures = [view_signature(shape.views) for shape in shapes]
    return DensitySample(
        _eigenvalues(shapes),
        np.array(signatures, dtype=np.uint8).reshape(len(shapes), SIGNATURE_BYTES),
        np.array([shape.views for shape in shapes], dtype=np.uint8).reshape(len(shapes), VIEW_BYTES),
    )


def densities_in(sample: DensitySample, shapes: list[ShapeDescriptors]) -> LocalDensities:
    """The local densities of c shapes, c at least 1, arrays of shape (c,), in a sample.

    A shape of the sample with the same eigenvalues, to their last bit, is the shape itself or a copy of it,
    and no neighbour. A density depends on the shape and the sample alone.
    """
    if not len(sample.views):
        return typical_densities(len(shapes))
    spectral = cdist(_eigenvalues(shapes), sample.eigenvalues)
    spectral[spectral == 0.0] = np.inf
    views = np.full(spectral.shape, UNMEASURED)
    views[np.isinf(spectral)] = np.inf
    for row, others, shape in zip(views, spectral, shapes, strict=True):
        near = signature_distance(view_signature(shape.views), sample.view_signatures).astype(np.float64)
        near[np.isinf(others)] = np.inf
        nearest = least(near, np.arange(len(near)), NEAR_VIEWS)
        nearest = nearest[np.isfinite(near[nearest])]
        row[nearest] = view_distance(shape.views, sample.views[nearest])
    return LocalDensities(
        neighbour_distances(spectral, TYPICAL_SPECTRAL), neighbour_distances(views, TYPICAL_VIEW)
    )


def _eigenvalues(shapes: list[ShapeDescriptors]) -> Floats:
    """The part of signatures without global descriptors, shape (c, e)."""
    if not shapes:
        return np.empty((0, 0))
    return np.stack([shape.signature[:-GLOBAL_DESCRIPTORS] for shape in shapes]).astype(np.float64)
