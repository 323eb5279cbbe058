"""Measurements that are invariant under rotation, reflection and scaling, which tell most pairs apart.

A rigid copy has the measurements of the first surface up to the sampling errors of both meshes, so that only
few pairs of a large collection need to be registered.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats
from core.registration.rigid_copy import COPY_RADIUS, COPY_SPECTRAL, EQUAL_RADIUS, EQUAL_VOLUME

EXTENT, HULL_AREA, OPEN_HULL_AREA = 0.008, 0.004, 0.016
"""Largest differences of the logarithms of two copies: of the extents of their bounding boxes, and of their
area over that of the hull, of closed and of open surfaces. Exports at another chord tolerance differ by at
most 0.0066 and 0.0017; their volumes, and the filled shares of their hulls, by half of `EQUAL_VOLUME`."""


@dataclass(frozen=True, eq=False)
class Invariants:
    """Measurements of n surfaces.

    Attributes
    ----------
    eigenvalues : float32, shape (n, m)
        Logarithms of normalised eigenvalues.
    descriptors : float64, shape (n, 3)
        `core.descriptors.facts.global_descriptors`.
    radii : float64, shape (n,)
        Root mean square distance from the centroid over the square root of the area.
    extents : float64, shape (n, 3)
        Logarithms of the extents of the bounding box over the square root of the area.
    closed : bool, shape (n,)
        Whether the surface has no boundary.
    """

    eigenvalues: Float32s
    descriptors: Floats
    radii: Floats
    extents: Floats
    closed: NDArray[np.bool_]

    def spectral_distances(self, index: int, others: NDArray[np.intp]) -> Floats:
        """Return the distances between the log eigenvalues of one surface and of k others, shape (k,)."""
        steps = self.eigenvalues[others].astype(np.float64) - self.eigenvalues[index]
        return np.asarray(np.linalg.norm(steps, axis=1))


def possible_copies(surfaces: Invariants, index: int) -> NDArray[np.intp]:
    """Return the indices of the other surfaces that may be rigid copies of a surface."""
    near = _of_radius(surfaces, index, EQUAL_RADIUS)
    gaps = np.abs(surfaces.extents[near] - surfaces.extents[index])
    near = near[(gaps <= EXTENT).all(axis=1)]
    gaps = np.abs(surfaces.descriptors[near] - surfaces.descriptors[index])
    # The volume of an open surface is only a number.
    closed = surfaces.closed[near] & surfaces.closed[index]
    within = (gaps <= [EQUAL_VOLUME, EQUAL_VOLUME, HULL_AREA]).all(axis=1) | (
        ~closed & (gaps[:, 2] <= OPEN_HULL_AREA)
    )
    return np.asarray(near[within], dtype=np.intp)


def possible_variants(surfaces: Invariants, index: int) -> NDArray[np.intp]:
    """Return the indices of the surfaces that may be variants of a surface (`may_be_copy`)."""
    near = _of_radius(surfaces, index, COPY_RADIUS)
    return np.asarray(near[surfaces.spectral_distances(index, near) <= COPY_SPECTRAL])


def _of_radius(surfaces: Invariants, index: int, most: float) -> NDArray[np.intp]:
    near = np.flatnonzero(np.abs(surfaces.radii - surfaces.radii[index]) <= most)
    return np.asarray(near[near != index])
