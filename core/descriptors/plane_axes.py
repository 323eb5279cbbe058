"""The axes of a plane whose second moments are equal in all directions: of gears, stars and regular prisms.

The angular distribution of the surface about the normal of the plane decides. The terms of its Fourier series
are the moments of z^m, z = x + iy, which are exact over triangles: the integral of z^m over a triangle is its
area times 2 / ((m + 1)(m + 2)) times the complete homogeneous symmetric polynomial h_m of its corners.
"""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats

ORDERS = np.arange(2, 13)
"""Orders m of the moments: a surface with an axis of up to twelvefold symmetry has one."""

ANGLES, STEPS = 720, 5
"""Number of angles among which the best is looked for, and of Newton steps from there."""


def directed(plane: Floats, corners: Floats, areas: Floats) -> Floats:
    """Axes of a plane, of which the first points to most of the surface by its angle, shape (2, 3).

    Parameters
    ----------
    plane : float64, shape (2, 3)
        Rows are orthonormal.
    corners : float64, shape (f, 3, 3)
        Corners of the faces; the centroid of the surface is the origin.
    areas : float64, shape (f,)
    """
    moments = moments_of_plane(corners @ plane[0] + 1j * (corners @ plane[1]), areas)
    angles = np.arange(ANGLES) * (2.0 * np.pi / ANGLES)
    angle = angles[np.argmax((np.exp(-1j * np.outer(angles, ORDERS)) @ moments).real)]
    for _ in range(STEPS):
        waves = np.exp(-1j * ORDERS * angle) * moments
        bend = (ORDERS**2 * waves.real).sum()
        if not bend > 0.0:
            break
        angle += (ORDERS * waves.imag).sum() / bend
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.asarray(turn @ plane)


def moments_of_plane(corners: NDArray[np.complex128], areas: Floats) -> NDArray[np.complex128]:
    """The integral of z^m over that of |z|^m, the latter by the corners, for each of `ORDERS`.

    Parameters
    ----------
    corners : complex128, shape (f, 3)
        x + iy of the corners.
    areas : float64, shape (f,)
    """
    powers = np.ones((3, len(corners)), dtype=complex)
    found = []
    for order in range(1, ORDERS[-1] + 1):
        powers[0] *= corners[:, 0]
        powers[1] = powers[0] + corners[:, 1] * powers[1]
        powers[2] = powers[1] + corners[:, 2] * powers[2]
        if order >= ORDERS[0]:
            size = areas @ (np.abs(corners) ** order).mean(axis=1)
            whole = 2.0 / ((order + 1) * (order + 2)) * (areas @ powers[2])
            found.append(whole / max(size, np.finfo(np.float64).tiny))
    return np.array(found)
