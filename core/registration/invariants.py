"""Measurements that are invariant under rotation, reflection and scaling, which tell most pairs apart.

A rigid copy has the measurements of the first surface up to the sampling errors of both meshes, so that only
few pairs of a large collection need to be registered.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Ints
from core.registration.rigid_copy import COPY_RADIUS, COPY_SPECTRAL, EQUAL_RADIUS

EXTENT, VOLUME, FILLED, HULL_AREA = 0.015, 0.02, 0.012, 0.016
"""Largest differences of the logarithms of two copies: of the extents of their bounding boxes; of the volume
of closed copies and of the share of the hull that they fill; and of their area over that of the hull."""

COARSE, GYRATION, COARSE_GYRATION = 2_000, 0.003, 0.005
"""Number of faces below which a mesh is coarse, and the largest differences of the logarithms of the radii of
gyration of two copies: of two fine meshes, and of two of which one is coarse. Among 1,500 machine parts all
382 pairs of copies, at chord tolerances that differ up to 50 times, pass all limits, and so do about 80 of a
million other pairs."""


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
    gyration : float64, shape (n, 3)
        Logarithms of the radii of gyration over the cube root of the volume.
    faces : int64, shape (n,)
        Numbers of faces.
    closed : bool, shape (n,)
        Whether the surface has no boundary.
    """

    eigenvalues: Float32s
    descriptors: Floats
    radii: Floats
    extents: Floats
    gyration: Floats
    faces: Ints
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
    compactness, filled, hull_area = np.abs(surfaces.descriptors[near] - surfaces.descriptors[index]).T
    gyration = np.abs(surfaces.gyration[near] - surfaces.gyration[index]).max(axis=1)
    coarse = np.minimum(surfaces.faces[near], surfaces.faces[index]) < COARSE
    solid = (
        (compactness <= VOLUME)
        & (filled <= FILLED)
        & (gyration <= np.where(coarse, COARSE_GYRATION, GYRATION))
    )
    # The volume of an open surface is only a number.
    closed = surfaces.closed[near] & surfaces.closed[index]
    within = (hull_area <= HULL_AREA) & (solid | ~closed)
    return np.asarray(near[within], dtype=np.intp)


def possible_variants(surfaces: Invariants, index: int) -> NDArray[np.intp]:
    """Return the indices of the surfaces that may be variants of a surface (`may_be_copy`)."""
    near = _of_radius(surfaces, index, COPY_RADIUS)
    return np.asarray(near[surfaces.spectral_distances(index, near) <= COPY_SPECTRAL])


def _of_radius(surfaces: Invariants, index: int, most: float) -> NDArray[np.intp]:
    near = np.flatnonzero(np.abs(surfaces.radii - surfaces.radii[index]) <= most)
    return np.asarray(near[near != index])
