"""Pose normalisation of a surface: its centre, its scale and three frames of axes, exact over its triangles.

P. Papadakis, I. Pratikakis, T. Theoharis, S. Perantonis, "PANORAMA: a 3D shape descriptor based on panoramic
views for unsupervised 3D object retrieval", International Journal of Computer Vision 89, 2010: principal axes
of the points (continuous PCA, Vranic 2001) and of the normals. Z. Lian, P. Rosin, X. Sun, "Rectilinearity of
3D meshes", International Journal of Computer Vision 89, 2010: axes along which the faces of man-made objects
lie. No sign of a normal is used, so the orientation of faces does not matter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import DegenerateMeshError
from core.mesh.cleaning import bounds
from core.mesh.mesh import face_normals
from core.mesh.normal_frame import second_moments
from core.numerics.compilation import compiled

FRAMES = 3
"""Number of frames: of the points, of the normals, and the rectilinear one."""

TIE_BREAK = 1e-3
"""Weight of the normals' tensor in the frame of the points, and of the points' in the frame of the normals:
the axes in the plane of a flat sheet are those of its points, although all its normals agree."""

CHUNK = 2**18
"""Number of faces whose moments are computed at a time, for less memory."""

SWEEPS, TURNED = 30, 1e-9
"""Largest number of sweeps to the rectilinear frame, and the angle that none of the last sweep exceeds."""

LEVEL = 1e-12
"""Differences of the integral below which all angles in a plane are equally good."""

TIED = 0.005
"""Two axes are tied if the second moments of points and of normals along them differ by less than this share
of the sum of all three; all angles in a plane are equally good if the fourth moments differ by less."""


@dataclass(frozen=True, eq=False)
class NormalisedSurface:
    """A surface with its centroid at the origin and a root mean square radius of 1.

    Attributes
    ----------
    points : float64, shape (n, 3)
        The vertices.
    areas : float64, shape (f,)
        Areas of the faces, of sum 1.
    normals : float64, shape (f, 3)
        Unit normals of the faces, of either sign; 0 for faces without area.
    frames : float64, shape (FRAMES, 3, 3)
        Rows are the axes of a frame, orthonormal, of either sign, in order of falling extent.
    """

    points: Floats
    areas: Floats
    normals: Floats
    frames: Floats


def normalised_surface(vertices: Floats, faces: Ints) -> NormalisedSurface:
    """Centre and scale a surface, and find its frames; raise DegenerateMeshError if it has no area."""
    # Centre and scale the surface, exactly over its triangles.
    low, high = bounds(vertices)
    extent = max(float((high - low).max()), float(np.finfo(np.float64).tiny))
    points = (vertices - 0.5 * (low + high)) / extent
    corners = points[faces]
    normals, middles = face_normals(corners, unit=False), corners.mean(axis=1)
    lengths = np.linalg.norm(normals, axis=1)
    if not lengths.sum() > 0.0:
        raise DegenerateMeshError("the surface has no area")
    areas = lengths / lengths.sum()
    normals /= np.maximum(lengths, np.finfo(np.float64).tiny)[:, None]
    points -= areas @ middles
    spread = second_moments(points, faces, areas)
    scale = np.sqrt(np.trace(spread))
    tilt = (normals * areas[:, None]).T @ normals
    points /= scale
    spread /= scale**2
    # Three frames: principal axes of the points and of the normals, and the rectilinear one.
    widest = np.linalg.eigh(spread - TIE_BREAK * tilt)[1].T[::-1]
    flattest = np.linalg.eigh(tilt - TIE_BREAK * spread)[1].T
    square = _rectilinear(normals, areas, (widest, flattest))
    square = square[np.argsort(-_along(square, spread), kind="stable")]
    frames = [widest, flattest, square]
    # Turn tied axes by the angular distribution of the surface in their plane.
    for frame, axes in enumerate(frames):
        ties = [all(_are_tied(axes[i : i + 2], tensor) for tensor in (spread, tilt)) for i in (0, 1)]
        if sum(ties) == 1:
            i = ties.index(True)
            plane = axes[i : i + 2]
            turned = directed(plane, points[faces], areas)
            if frame == FRAMES - 1 and not _is_round(normals @ plane.T, areas):
                turned = plane if abs(turned[0] @ plane[0]) >= abs(turned[0] @ plane[1]) else plane[::-1]
            frames[frame] = np.concatenate([axes[:i], turned, axes[i + 2 :]])
    return NormalisedSurface(points, areas, normals, np.stack(frames))


def directed_axes(surface: NormalisedSurface, faces: Ints) -> Floats:
    """Return the frame of the points, each axis towards the side where the surface reaches farther.

    The integral of the third power of the coordinate, exact over the triangles, is positive. The axes may be
    left-handed: a surface and its mirror image have mirrored axes.
    """
    axes = surface.frames[0]
    a, b, c = np.moveaxis(surface.points[faces] @ axes.T, 1, 0)
    cubes = (a + b + c) * (a * a + b * b + c * c) + a * b * c
    signs = np.where(surface.areas @ cubes < 0.0, -1.0, 1.0)
    return np.asarray(axes * signs[:, None])


def _along(axes: Floats, tensor: Floats) -> Floats:
    """Return the second moments along axes, rows."""
    return np.asarray(np.einsum("ai,ij,aj->a", axes, tensor, axes))


def _are_tied(plane: Floats, tensor: Floats) -> bool:
    """Return whether the second moments along two axes are nearly equal."""
    first, second = _along(plane, tensor)
    return bool(abs(first - second) < TIED)


def _is_round(normals: Floats, areas: Floats) -> bool:
    """Return whether fourth moments hardly depend on the angle in a plane; normals in it, shape (f, 2)."""
    return bool(abs(areas @ (normals[:, 0] + 1j * normals[:, 1]) ** 4) < TIED)


def _rectilinear(normals: Floats, areas: Floats, starts: tuple[Floats, ...]) -> Floats:
    """Find axes, rows, that maximise the integral of the sum of (n . axis)^4, from the better of the starts.

    Jacobi sweeps: each pair of axes turns in its plane to the best angle, which is known in closed form (P.
    Comon, "Independent component analysis, a new concept?", Signal Processing 36, 1994).
    """
    moments = np.zeros((9, 9))
    for low in range(0, len(normals), CHUNK):
        chunk = slice(low, low + CHUNK)
        pairs = np.einsum("fi,fj->fij", normals[chunk], normals[chunk]).reshape(-1, 9)
        moments += (pairs * areas[chunk, None]).T @ pairs
    best_value, best_axes = -np.inf, starts[0]
    for start in starts:
        axes = start.copy()
        for _ in range(SWEEPS):
            if max(_turn(axes, i, j, moments) for i, j in ((0, 1), (1, 2), (2, 0))) < TURNED:
                break
        value = sum(_integral(moments, axis, axis, axis, axis) for axis in axes)
        if value > best_value + TURNED:
            best_value, best_axes = value, axes
    return best_axes


@compiled
def _integral(moments: Floats, a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """Return the integral of (n . a) (n . b) (n . c) (n . d), from the moments of n n^T, shape (9, 9)."""
    total = 0.0
    for i in range(9):
        for j in range(9):
            total += moments[i, j] * (a[i // 3] * b[i % 3]) * (c[j // 3] * d[j % 3])
    return total


@compiled
def _turn(axes: Floats, i: int, j: int, moments: Floats) -> float:
    """Turn two axes in their plane, in place, to the best angle, which is returned."""
    first, second = axes[i].copy(), axes[j].copy()
    even = _integral(moments, first, first, first, first) + _integral(moments, second, second, second, second)
    even -= 6.0 * _integral(moments, first, first, second, second)
    odd = _integral(moments, first, first, first, second) - _integral(moments, second, second, second, first)
    if np.hypot(even, 4.0 * odd) < LEVEL:
        return 0.0
    angle = 0.25 * np.arctan2(4.0 * odd, even)
    axes[i] = np.cos(angle) * first + np.sin(angle) * second
    axes[j] = np.cos(angle) * second - np.sin(angle) * first
    return float(abs(angle))


ORDERS = np.arange(2, 13)
"""Orders m of the moments: a surface with an axis of up to twelvefold symmetry has one."""

ANGLES, STEPS = 720, 5
"""Number of angles among which the best is looked for, and of Newton steps from there."""


def directed(plane: Floats, corners: Floats, areas: Floats) -> Floats:
    """Return axes of a plane, the first towards most of the surface by its angle, shape (2, 3).

    The rows of the plane are orthonormal; the centroid of the faces, of corners (f, 3, 3), is the origin.
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
    """Return the integral of z^m over that of |z|^m, by corners z of shape (f, 3), for each of `ORDERS`."""
    powers = np.ones((3, len(corners)), dtype=complex)
    moments = []
    for order in range(1, ORDERS[-1] + 1):
        powers[0] *= corners[:, 0]
        powers[1] = powers[0] + corners[:, 1] * powers[1]
        powers[2] = powers[1] + corners[:, 2] * powers[2]
        if order >= ORDERS[0]:
            size = areas @ (np.abs(corners) ** order).mean(axis=1)
            whole = 2.0 / ((order + 1) * (order + 2)) * (areas @ powers[2])
            moments.append(whole / max(size, np.finfo(np.float64).tiny))
    return np.array(moments)
