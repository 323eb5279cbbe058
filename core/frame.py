"""The normal frame: centroid at the origin, principal axes, unit root mean square radius, all by area."""

from dataclasses import dataclass

import numpy as np

from core.cleaning import face_areas
from core.mesh import Floats, Mesh

TIE = 0.02
"""Axes are tied when their second moments differ by less than this part of the larger one: then a small
change of the surface may swap them, and a rule decides instead."""

VANISHING = 0.02
"""An angular moment below this part of the radial one counts as zero."""


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


def _moments(mesh: Mesh) -> tuple[Floats, Floats, float]:
    """Centroid, second-moment matrix about it by area (exact for flat faces), and the area."""
    corners = mesh.vertices[mesh.faces]
    areas = face_areas(mesh.vertices, mesh.faces)
    total = float(areas.sum())
    centre = np.asarray((areas[:, None] * corners.mean(axis=1)).sum(axis=0) / total)
    corners = corners - centre
    sums = corners.sum(axis=1)
    second = np.einsum("f,fci,fcj->ij", areas, corners, corners) + np.einsum("f,fi,fj->ij", areas, sums, sums)
    return centre, np.asarray(second / (12.0 * total)), total


def _turn(points: Floats, weights: Floats, u: Floats, v: Floats) -> Floats:
    """A direction in the plane of two tied axes, from the lowest angular moment that does not vanish.

    The m-th moment, sum of w r^m exp(i m theta), turns with the shape; its phase over m is a direction, the
    same up to the symmetry that the moment itself has. A body of revolution has none, and any will do.
    """
    plane = (points @ u) + 1j * (points @ v)
    for order in (3, 5, 2, 4, 6, 7, 8):
        moment = complex((weights * plane**order).sum())
        size = float((weights * np.abs(plane) ** order).sum())
        if abs(moment) > VANISHING * size:
            angle = np.angle(moment) / order
            return np.asarray(np.cos(angle) * u + np.sin(angle) * v)
    return u


def normal_frame(mesh: Mesh) -> Frame:
    """The frame of Eq. 4's fit z = f(x, y), the same for every tessellation of a surface.

    Tied axes: where all three are, x points to the surface's farthest point; where two are, `_turn` picks the
    first of them. Signs come from the third moments, so that a turned copy gets the turned frame.
    """
    centre, second, _ = _moments(mesh)
    scale = float(np.sqrt(np.trace(second)))
    areas = face_areas(mesh.vertices, mesh.faces)
    points = (mesh.vertices[mesh.faces].mean(axis=1) - centre) / scale
    weights = areas / areas.sum()
    values, vectors = np.linalg.eigh(second)
    values, axes = values[::-1], vectors.T[::-1].copy()
    tied = values[:-1] - values[1:] < TIE * values[:-1]
    if tied.all():
        offsets = mesh.vertices - centre
        axes[0] = offsets[np.argmax(np.einsum("ni,ni->n", offsets, offsets))]
        axes[0] /= np.linalg.norm(axes[0])
        helper = np.eye(3)[np.argmin(np.abs(axes[0]))]
        axes[1] = np.cross(axes[0], helper)
        axes[1] /= np.linalg.norm(axes[1])
        axes[2] = np.cross(axes[0], axes[1])
        tied[0] = False
    if tied[0]:
        axes[0] = _turn(points, weights, axes[0], axes[1])
        axes[1] = np.cross(axes[2], axes[0])
    elif tied[1]:
        axes[1] = _turn(points, weights, axes[1], axes[2])
    skew = weights @ (points @ axes[:2].T) ** 3
    axes[:2] *= np.where(skew < 0.0, -1.0, 1.0)[:, None]
    axes[2] = np.cross(axes[0], axes[1])
    return Frame(centre=centre, axes=axes, scale=scale)
