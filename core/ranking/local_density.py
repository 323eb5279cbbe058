"""Local density: the distance of a shape to its nearest neighbours among the stored shapes.

A shape that is near to everything is a hub: it is the first answer to many queries, mostly wrongly. Local
scaling divides a distance by the root of the product of both shapes' distances to their seventh neighbours
(L. Zelnik-Manor, P. Perona, "Self-tuning spectral clustering", NIPS 2004); D. Schnitzer et al., "Local and
global scaling reduce hubs in space", JMLR 13, 2012.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from core.arrays import Bytes, Float32s, Floats, Int8s, Ints
from core.descriptors.facts import GLOBAL_DESCRIPTORS
from core.descriptors.network import FEATURES
from core.descriptors.network_views import mean_view, network_view_distance
from core.descriptors.registry import ShapeDescriptors
from core.descriptors.views import (
    SIGNATURE_BYTES,
    VIEW_BYTES,
    VIEW_SCALE,
    signature_distance,
    view_distance,
    view_signature,
)
from core.ranking.kinds import KindCoordinates, Kinds, kinds_in, without_kinds
from core.ranking.shortlist import least
from core.spectral.spectral_embedding import SPECTRUM

NETWORK = "network_views"
"""The name of the descriptor that some shapes lack."""

NEIGHBOUR = 7
"""The neighbour whose distance measures the density."""

TYPICAL_SPECTRAL, TYPICAL_VIEW, TYPICAL_NETWORK = 0.14, 0.76, 0.45
"""Distances to the seventh neighbour that count as typical: near the medians of the collections of the
calibration."""

ENOUGH = 100
"""Number of shapes from which their distances alone tell the density."""

MEASURED = 64
"""Largest number of shapes of a sample whose densities give the median of all: those of least hash."""


@dataclass(frozen=True, eq=False)
class LocalDensities:
    """The surroundings of shapes among the stored shapes.

    `spectral`, `view` and `network`, float64 of shape (c,), > 0, are distances to the seventh neighbours by
    eigenvalues, by views, and by views that a network sees. Both distances by views are `lifted`. `kinds`
    has the kind of each shape.
    """

    spectral: Floats
    view: Floats
    network: Floats
    kinds: KindCoordinates

    def only(self, indices: Ints) -> "LocalDensities":
        """Return the densities of the shapes at some indices."""
        return LocalDensities(
            self.spectral[indices],
            self.view[indices],
            self.network[indices],
            KindCoordinates(self.kinds.kinds[indices], self.kinds.coordinates[indices]),
        )


def typical_densities(count: int) -> LocalDensities:
    """Return the densities of `count` shapes where no stored shapes are known."""
    spectral, view, network = (
        np.full(count, typical) for typical in (TYPICAL_SPECTRAL, TYPICAL_VIEW, TYPICAL_NETWORK)
    )
    return LocalDensities(spectral, view, network, without_kinds(count))


def neighbour_distances(distances: Floats, typical: float) -> Floats:
    """Return the distance of each of c shapes to its seventh neighbour among n others, shape (c,).

    `distances`, shape (c, m), are those to the m shapes of a sample, >= 0, and inf between a shape and
    itself; `typical` is `TYPICAL_SPECTRAL`, `TYPICAL_VIEW` or `TYPICAL_NETWORK`. With n below `ENOUGH`, the
    result is the geometric mean of the typical distance and of that to the seventh neighbour, or to the last
    one of fewer; the weight of the latter is n / `ENOUGH`.
    """
    others = np.isfinite(distances).sum(axis=1)
    if not distances.shape[1]:
        return np.full(len(distances), typical)
    nearest = np.sort(np.partition(distances, min(NEIGHBOUR, distances.shape[1]) - 1)[:, :NEIGHBOUR])
    last = np.clip(others, 1, NEIGHBOUR) - 1
    distance = nearest[np.arange(len(distances)), last]
    weight = np.minimum(others / ENOUGH, 1.0)
    known = np.where(others > 0, np.maximum(distance, 1e-6), typical)
    return np.asarray(known**weight * typical ** (1.0 - weight))


def lifted(densities: Floats, median: float, typical: float) -> Floats:
    """Return distances to seventh neighbours, raised by one factor if their median is below the typical one.

    No distance is raised above the typical one. Where most stored shapes look alike, as machine parts and
    people do, near neighbours do not make a hub.
    """
    raised = max(1.0, typical / median) * densities
    return np.asarray(np.minimum(raised, np.maximum(densities, typical)))


NEAR_VIEWS = 16
"""Number of shapes, the nearest by view signature or by mean view, whose distances are computed: the seventh
nearest by view distance is mostly among them."""

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
    network_views : list of int8 arrays
        The views of the shapes that have them.
    mean_views : float32, shape (n, FEATURES)
        `core.descriptors.network_views.mean_view` of those.
    with_network : bool, shape (m,)
        Whether a shape is one of those, n in all.
    kinds : Kinds
        Kinds of nearly isometric shapes among them.
    view_median, network_median : float
        Medians of their own densities by views, and by views that a network sees, before these are lifted.
    """

    eigenvalues: Floats
    view_signatures: Bytes
    views: Bytes
    network_views: list[Int8s]
    mean_views: Float32s
    with_network: NDArray[np.bool_]
    kinds: Kinds
    view_median: float = TYPICAL_VIEW
    network_median: float = TYPICAL_NETWORK


def density_sample(shapes: list[ShapeDescriptors]) -> DensitySample:
    """Return the sample of some shapes, in their order."""
    views = all_views(shapes)
    signatures = [view_signature(descriptor) for descriptor in views]
    network_views = [shape.arrays[NETWORK] for shape in shapes if NETWORK in shape.arrays]
    means = [mean_view(each) for each in network_views]
    sample = DensitySample(
        _eigenvalues(np.stack([shape.signature for shape in shapes])) if shapes else np.empty((0, 0)),
        np.array(signatures, dtype=np.uint8).reshape(len(shapes), SIGNATURE_BYTES),
        views,
        network_views,
        np.array(means, dtype=np.float32).reshape(len(means), FEATURES),
        np.array([NETWORK in shape.arrays for shape in shapes], dtype=bool),
        kinds_in(all_log_eigenvalues(shapes), views),
    )
    some = sorted(shapes, key=lambda shape: crc32(shape.signature.tobytes()))[:MEASURED]
    if not some:
        return sample
    own = densities_in(sample, some)
    seen = own.network[[NETWORK in shape.arrays for shape in some]]
    return replace(
        sample,
        view_median=float(np.median(own.view)),
        network_median=float(np.median(seen)) if len(seen) else TYPICAL_NETWORK,
    )


def densities_in(sample: DensitySample, shapes: list[ShapeDescriptors]) -> LocalDensities:
    """Return the local densities of c shapes, c at least 1, arrays of shape (c,), in a sample.

    A shape of the sample with the same eigenvalues, to their last bit, is the shape itself or a copy of it,
    and no neighbour. A density depends on the shape and the sample alone.
    """
    if not len(sample.views):
        return typical_densities(len(shapes))
    spectral = _spectral_distances(sample, np.stack([shape.signature for shape in shapes]))
    views = np.full(spectral.shape, UNMEASURED)
    views[np.isinf(spectral)] = np.inf
    for row, others, shape in zip(views, spectral, shapes, strict=True):
        signature = view_signature(shape.arrays["views"])
        nearest = _nearest(signature_distance(signature, sample.view_signatures), others)
        row[nearest] = view_distance(shape.arrays["views"], sample.views[nearest])
    view = neighbour_distances(views, TYPICAL_VIEW)
    network = neighbour_distances(_network_distances(sample, shapes, spectral), TYPICAL_NETWORK)
    return LocalDensities(
        neighbour_distances(spectral, TYPICAL_SPECTRAL),
        lifted(view, sample.view_median, TYPICAL_VIEW),
        lifted(network, sample.network_median, TYPICAL_NETWORK),
        sample.kinds.of(all_log_eigenvalues(shapes)),
    )


def estimated_densities(
    sample: DensitySample, signatures: Float32s, view_signatures: Bytes
) -> LocalDensities:
    """Estimate the local densities of c shapes in a sample, arrays of shape (c,), from short descriptors.

    Densities by eigenvalues are exact, and densities by a network typical; view signatures stand for views,
    and the shapes are of no kind. Signatures have the shape (c, s), and view signatures (c, SIGNATURE_BYTES).
    """
    densities = typical_densities(len(signatures))
    if not len(sample.views) or not len(signatures):
        return densities
    spectral = _spectral_distances(sample, signatures)
    distances = [signature_distance(signature, sample.view_signatures) for signature in view_signatures]
    views = np.where(np.isinf(spectral), np.inf, VIEW_SCALE * np.stack(distances))
    return replace(
        densities,
        spectral=neighbour_distances(spectral, TYPICAL_SPECTRAL),
        view=lifted(neighbour_distances(views, TYPICAL_VIEW), sample.view_median, TYPICAL_VIEW),
    )


def _spectral_distances(sample: DensitySample, signatures: Float32s) -> Floats:
    """Return the distances by eigenvalues between c shapes and those of a sample, inf to itself or a copy."""
    distances: Floats = cdist(_eigenvalues(signatures), sample.eigenvalues)
    distances[distances == 0.0] = np.inf
    return distances


def _network_distances(sample: DensitySample, shapes: list[ShapeDescriptors], spectral: Floats) -> Floats:
    """Return the distances by views of a network between c shapes and those of a sample that have them.

    They are infinite between a shape and itself, and from a shape without such views.
    """
    known = sample.with_network
    distances = np.full((len(shapes), len(sample.network_views)), np.inf)
    for row, others, shape in zip(distances, spectral[:, known], shapes, strict=True):
        views = shape.arrays.get(NETWORK)
        if views is not None:
            row[np.isfinite(others)] = UNMEASURED
            nearest = _nearest(1.0 - sample.mean_views @ mean_view(views), others)
            if len(nearest):
                row[nearest] = network_view_distance(views, [sample.network_views[i] for i in nearest])
    return distances


def _nearest(distances: NDArray[np.generic], others: Floats) -> Ints:
    """Return the places of the `NEAR_VIEWS` least distances where those to `others` are finite."""
    near = np.where(np.isinf(others), np.inf, distances.astype(np.float64))
    nearest = least(near, np.arange(len(near)), NEAR_VIEWS)
    return np.asarray(nearest[np.isfinite(near[nearest])])


def _eigenvalues(signatures: Float32s) -> Floats:
    """Return the part of signatures without global descriptors, shape (c, e)."""
    return signatures[:, :-GLOBAL_DESCRIPTORS].astype(np.float64)


def all_log_eigenvalues(shapes: Sequence[ShapeDescriptors]) -> Floats:
    """Return the log eigenvalues of c shapes, shape (c, SPECTRUM), NaN for shapes without them."""
    unknown = np.full(SPECTRUM, np.nan)
    rows = [shape.arrays.get("eigenvalues", unknown) for shape in shapes]
    return np.array(rows, dtype=np.float64).reshape(len(shapes), SPECTRUM)


def all_views(shapes: Sequence[ShapeDescriptors]) -> Bytes:
    """Return the views of c shapes, shape (c, VIEW_BYTES)."""
    rows = [shape.arrays["views"] for shape in shapes]
    return np.array(rows, dtype=np.uint8).reshape(len(shapes), VIEW_BYTES)
