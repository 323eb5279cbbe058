"""The normal frame of a surface: its centroid and its principal axes, weighted by area."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, independent_weights
from core.numerics.compilation import compiled_for_reading

Complexes = NDArray[np.complex128]

TIED = 0.02
"""Axes are tied if their second moments differ by less than this fraction of the larger one. A small change
of the surface may swap tied axes, so a rule decides between them."""

VANISHING = 0.02
"""A planar moment below this fraction of the radius to its order counts as zero."""

ORDERS = (3, 5, 2, 4, 6, 7, 8)
"""Orders of the planar moments, in the order of use."""

SYMMETRIC = 1e-5
"""A third moment below this fraction of the cubed scale is rounding and cannot decide the sign of an axis."""


@dataclass(frozen=True, eq=False)
class NormalFrame:
    """The similarity transform from the file's frame to the normal frame.

    `centre`, shape (3,), is the area centroid; the rows of `axes`, shape (3, 3), are the x, y and z axes, the
    largest variance first, a right-handed rotation; `scale` is the root mean square distance of the surface
    from the centroid. Lengths are in file units.
    """

    centre: Floats
    axes: Floats
    scale: float

    def apply(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3), from the file's frame to the normal frame."""
        return np.asarray((points - self.centre) @ self.axes.T / self.scale)

    def invert(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3), from the normal frame to the file's frame."""
        return np.asarray(points * self.scale @ self.axes + self.centre)


def _mean_power(values: Floats | Complexes, faces: Ints, areas: Floats, order: int) -> complex:
    """Return the mean over the surface of the m-th power of a linear function, given at the vertices.

    The mean is exact on planar faces, so it does not depend on the tessellation: over one triangle it is
    2 / ((m + 1)(m + 2)) times the complete homogeneous symmetric polynomial of degree m of the three values.
    """
    total = _power_sum(values.astype(np.complex128), faces, areas, order)
    return complex(2.0 / ((order + 1) * (order + 2)) * total / areas.sum())


@compiled_for_reading
def _power_sum(values: Complexes, faces: Ints, areas: Floats, order: int) -> np.complex128:
    """Return the sum over the faces of area times the symmetric polynomial."""
    total = np.complex128(0.0)
    terms = np.empty(order + 1, dtype=np.complex128)
    for f in range(len(faces)):
        terms[:] = 0.0
        terms[0] = 1.0
        for corner in range(3):
            value = values[faces[f, corner]]
            for i in range(1, order + 1):
                terms[i] += value * terms[i - 1]
        total += areas[f] * terms[order]
    return total


def second_moments(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """Return the mean of p p^T over the surface, exact on planar faces, shape (3, 3)."""
    upper = _second_sum(vertices, faces, areas)
    return np.asarray((upper + upper.T - np.diag(np.diag(upper))) / (12.0 * areas.sum()))


@compiled_for_reading
def _second_sum(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """Return the upper triangle of 12 times the sum over faces of area times the mean of p p^T."""
    second = np.zeros((3, 3))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for i in range(3):
            total = vertices[a, i] + vertices[b, i] + vertices[c, i]
            for j in range(i, 3):
                product = vertices[a, i] * vertices[a, j]
                product += vertices[b, i] * vertices[b, j]
                product += vertices[c, i] * vertices[c, j]
                product += total * (vertices[a, j] + vertices[b, j] + vertices[c, j])
                second[i, j] += areas[f] * product
    return second


def _farthest(offsets: Floats) -> Floats:
    """Return the longest row as a unit vector; the first of equally long rows."""
    squares = np.einsum("ni,ni->n", offsets, offsets)
    row = offsets[np.argmax(squares >= (1.0 - TIE) * squares.max())]
    return np.asarray(row / np.linalg.norm(row))


def _ordered_sum(mesh: Mesh) -> Floats:
    """Return a vector from the canonical order of the vertices; it decides between symmetric directions."""
    return np.asarray(independent_weights(np.arange(len(mesh.vertices))) @ mesh.vertices)


def _sign(mesh: Mesh, areas: Floats, axis: Floats) -> float:
    """Return the sign of the third moment along an axis, 1 or -1."""
    skew = _mean_power(mesh.vertices @ axis, mesh.faces, areas, 3).real
    if abs(skew) < SYMMETRIC:
        skew = float(_ordered_sum(mesh) @ axis)
    return -1.0 if skew < 0.0 else 1.0


def _tied_axis(mesh: Mesh, areas: Floats, normal: Floats) -> Floats:
    """Return a direction perpendicular to `normal` that rotates with the shape, for tied axes of the plane.

    `mesh` is centred. The planar moment of order m is the mean of (u + iv)^m; its phase over m is a direction
    up to rotations by 1/m of a circle, and moments along oblique lines choose among these. On a body of
    revolution all planar moments vanish; the vertex farthest from the axis gives the direction.
    """
    across = mesh.vertices - np.outer(mesh.vertices @ normal, normal)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    radius = float(np.sqrt(np.trace(second_moments(across, mesh.faces, areas))))
    plane = (across @ u + 1j * (across @ v)) / radius
    for order in ORDERS:
        moment = _mean_power(plane, mesh.faces, areas, order)
        if abs(moment) > VANISHING:
            angles = (np.angle(moment) + 2.0 * np.pi * np.arange(order)) / order
            directions = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
            slants = 0.6 * _sign(mesh, areas, normal) * normal + 0.8 * directions
            values = [mesh.vertices @ slant for slant in slants]
            leans = np.array(
                [sum(_mean_power(value, mesh.faces, areas, n).real for n in (3, 4, 5, 6)) for value in values]
            )
            tied = directions[leans >= leans.max() - SYMMETRIC]
            return np.asarray(tied[np.argmax(tied @ _ordered_sum(mesh))])
    return _farthest(across)


def normal_frame(mesh: Mesh) -> NormalFrame:
    """Return the frame for the fit z = f(x, y) of Eq. 4, independent of the tessellation.

    z is the direction of least spread. If all three axes are tied, x points to the surface's farthest point;
    if two are, `_tied_axis` chooses the first of them. Third moments give the signs, so that a rotated copy
    gets the rotated frame. The area is > 0.
    """
    areas = face_areas(mesh.vertices, mesh.faces)
    centre = centroid(mesh.vertices, mesh.faces, areas)
    second = second_moments(mesh.vertices - centre, mesh.faces, areas)
    scale = float(np.sqrt(np.trace(second)))
    unit = Mesh((mesh.vertices - centre) / scale, mesh.faces)
    values, vectors = np.linalg.eigh(second)
    values, axes = values[::-1], vectors.T[::-1].copy()
    tied = values[:-1] - values[1:] < TIED * values[:-1]
    if tied.all():
        axes[0] = _farthest(unit.vertices)
    if tied[1]:
        axes[1] = _tied_axis(unit, areas, axes[0])
    elif tied[0]:
        axes[0] = _tied_axis(unit, areas, axes[2])
        axes[1] = np.cross(axes[2], axes[0])
    for i in (0, 1):
        axes[i] *= _sign(unit, areas, axes[i])
    axes[2] = np.cross(axes[0], axes[1])
    return NormalFrame(centre=centre, axes=axes, scale=scale)
