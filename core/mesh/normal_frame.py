"""The normal frame: centroid at the origin, principal axes, unit root mean square radius, all by area."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, independent_weights
from core.numerics.compilation import compiled, constant

Complexes = NDArray[np.complex128]

TIED = 0.02
"""Axes are tied when their second moments differ by less than this part of the larger one: then a small
change of the surface may swap them, and a rule decides instead."""

VANISHING = 0.02
"""A moment of the plane below this part of its radius' power counts as zero."""

ORDERS = (3, 5, 2, 4, 6, 7, 8)
"""Orders of the plane's moments, in the order they are asked."""

SYMMETRIC = 1e-5
"""A third moment below this part of the cubed scale is rounding, and says nothing of an axis' sign."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A similarity from the file's frame to the normal one.

    Attributes
    ----------
    centre : float64, shape (3,)
        Area centroid, in file units.
    axes : float64, shape (3, 3)
        Rows are the x, y, z axes: largest spread first, a right-handed rotation.
    scale : float
        Root mean square distance of the surface from the centroid, in file units.
    """

    centre: Floats
    axes: Floats
    scale: float

    def apply(self, points: Floats) -> Floats:
        """Points of the file, shape (n, 3), in the normal frame."""
        return np.asarray((points - self.centre) @ self.axes.T / self.scale)

    def invert(self, points: Floats) -> Floats:
        """Points of the normal frame, shape (n, 3), in the file's."""
        return np.asarray(points * self.scale @ self.axes + self.centre)


def _mean_power(values: Floats | Complexes, faces: Ints, areas: Floats, order: int) -> complex:
    """Mean over the surface of a power of a linear function, from its values at the vertices, shape (n,).

    Exact on flat faces, so the same for every tessellation: over one triangle it is 2 / ((m + 1)(m + 2))
    times the complete homogeneous symmetric polynomial of degree m of the three values.
    """
    total = _power_sum(values.astype(np.complex128), constant(faces), areas, order)
    return complex(2.0 / ((order + 1) * (order + 2)) * total / areas.sum())


@compiled
def _power_sum(values: Complexes, faces: Ints, areas: Floats, order: int) -> np.complex128:
    """The sum over faces of area times the polynomial."""
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


def _second_moments(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """Mean of p p^T over the surface, exact on flat faces, shape (3, 3)."""
    upper = _second_sum(constant(vertices), constant(faces), areas)
    return np.asarray((upper + upper.T - np.diag(np.diag(upper))) / (12.0 * areas.sum()))


@compiled
def _second_sum(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """The sum over faces of 12 times the area times the mean of p p^T, the upper triangle, shape (3, 3)."""
    second = np.zeros((3, 3))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for i in range(3):
            total = vertices[a, i] + vertices[b, i] + vertices[c, i]
            for j in range(i, 3):
                here = vertices[a, i] * vertices[a, j]
                here += vertices[b, i] * vertices[b, j]
                here += vertices[c, i] * vertices[c, j]
                here += total * (vertices[a, j] + vertices[b, j] + vertices[c, j])
                second[i, j] += areas[f] * here
    return second


def _farthest(offsets: Floats) -> Floats:
    """The longest row, of equal ones the first, as a unit vector."""
    squares = np.einsum("ni,ni->n", offsets, offsets)
    row = offsets[np.argmax(squares >= (1.0 - TIE) * squares.max())]
    return np.asarray(row / np.linalg.norm(row))


def _ordered_sum(mesh: Mesh) -> Floats:
    """A vector from the vertices' order, to decide between directions that are alike on the surface."""
    return np.asarray(independent_weights(np.arange(len(mesh.vertices))) @ mesh.vertices)


def _sign(mesh: Mesh, areas: Floats, axis: Floats) -> float:
    """1 or -1: to which side of the centroid the surface leans along an axis."""
    skew = _mean_power(mesh.vertices @ axis, mesh.faces, areas, 3).real
    if abs(skew) < SYMMETRIC:
        skew = float(_ordered_sum(mesh) @ axis)
    return -1.0 if skew < 0.0 else 1.0


def _tied_axis(mesh: Mesh, areas: Floats, normal: Floats) -> Floats:
    """A direction across `normal` that turns with the shape, where the plane's own axes are tied.

    `mesh` is centred. The m-th moment of the plane, the mean of (u + iv)^m, has a phase, and 1/m of it is a
    direction up to turns by 1/m of a circle; among these a slanting line's moments choose. Where all of the
    plane's vanish, as on a body of revolution, it is the direction of the vertex farthest from the axis.
    """
    across = mesh.vertices - np.outer(mesh.vertices @ normal, normal)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    radius = float(np.sqrt(np.trace(_second_moments(across, mesh.faces, areas))))
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
            alike = directions[leans >= leans.max() - SYMMETRIC]
            return np.asarray(alike[np.argmax(alike @ _ordered_sum(mesh))])
    return _farthest(across)


def normal_frame(mesh: Mesh) -> Frame:
    """The frame of Eq. 4's fit z = f(x, y), the same for every tessellation of a surface.

    z is the direction of least spread. If all three axes are tied, x points to the surface's farthest point;
    if two are, `_tied_axis` chooses the first of them. Third moments give the signs, so that a rotated copy
    gets the rotated frame.

    Parameters
    ----------
    mesh : Mesh
        With area > 0.
    """
    areas = face_areas(mesh.vertices, mesh.faces)
    centre = centroid(mesh.vertices, mesh.faces, areas)
    second = _second_moments(mesh.vertices - centre, mesh.faces, areas)
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
    return Frame(centre=centre, axes=axes, scale=scale)
