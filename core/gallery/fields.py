"""Signed distance fields of simple solids: negative inside, positive outside.

They are exact for boxes, plates and solids of revolution. The others are accurate to first order near the
surface, which suffices for an isosurface at zero.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats
from core.gallery.frames import Frame

_TINY = 1e-12
"""Replaces a length of zero in a denominator."""


@dataclass(frozen=True, eq=False)
class Field:
    """A solid by its signed distance.

    Attributes
    ----------
    low, high : float64, shape (3,)
        Corners of a box around the solid.
    thickness : float
        Least extent, which a grid must resolve.
    distance : callable
        Signed distances, shape (n,), of points of shape (n, 3).
    frame : Frame
        The solid's own frame, which moves with it. A bone's frame is at its start, with x along the bone.
    round : bool
        Whether the solid is rotationally symmetric about the frame's x axis.
    """

    low: Floats
    high: Floats
    thickness: float
    distance: Callable[[Floats], Floats]
    frame: Frame
    round: bool = False


def capsule(start: Floats, end: Floats, radii: tuple[float, float], across: Floats, squash: float) -> Field:
    """A rounded bone whose radius goes linearly from one end to the other.

    It is `squash` times thinner along the unit vector `across`, shape (3,).
    """
    first, last = radii
    stretch = np.eye(3) + (squash - 1.0) * np.outer(across, across)
    line = stretch @ (end - start)
    squared = max(float(line @ line), _TINY)

    def distance(points: Floats) -> Floats:
        offset = (points - start) @ stretch
        along = np.clip(offset @ line / squared, 0.0, 1.0)
        offset -= along[:, None] * line
        length = _lengths(offset)
        gap: Floats = length - (first + along * (last - first))
        if squash == 1.0:
            return gap
        # The gap is one in stretched space; over the size of its gradient it is a distance to first order.
        slope = _lengths(offset @ stretch) / np.maximum(length, _TINY)
        return gap / np.maximum(slope, 1.0)

    low, high = np.minimum(start - first, end - last), np.maximum(start + first, end + last)
    frame = Frame(start, _axes_along(end - start, across))
    return Field(low, high, (first + last) / squash, distance, frame, round=squash == 1.0)


def ellipsoid(frame: Frame, radii: Floats) -> Field:
    """An ellipsoid with semi-axes `radii`, shape (3,), along the axes of its frame."""
    least = float(radii.min())

    def distance(points: Floats) -> Floats:
        scaled = frame.local(points) / radii
        level, slope = _lengths(scaled), _lengths(scaled / radii)
        return np.where(level > 1e-6, level * (level - 1.0) / np.maximum(slope, _TINY), -least)

    reach = np.linalg.norm(frame.axes * radii, axis=1)
    return Field(frame.origin - reach, frame.origin + reach, 2.0 * least, distance, frame)


def box(frame: Frame, half: Floats, rounding: float) -> Field:
    """A box with half extents `half`, shape (3,), whose edges are rounded by `rounding` <= min(half)."""

    def distance(points: Floats) -> Floats:
        beyond = np.abs(frame.local(points)) - (half - rounding)
        inside: Floats = np.minimum(beyond.max(axis=1), 0.0)
        return _lengths(np.maximum(beyond, 0.0)) + inside - rounding

    reach = np.abs(frame.axes) @ half
    return Field(frame.origin - reach, frame.origin + reach, 2.0 * float(half.min()), distance, frame)


def plate(frame: Frame, outline: Floats, half: float) -> Field:
    """A simple polygon, shape (m, 2), in the x, y plane of a frame, grown by `half` all round: a fin."""

    def distance(points: Floats) -> Floats:
        local = frame.local(points)
        sideways = np.maximum(polygon_distance(local[:, :2], outline), 0.0)
        return np.hypot(sideways, local[:, 2]) - half

    corners = frame.origin + outline @ frame.axes[:, :2].T
    return Field(corners.min(axis=0) - half, corners.max(axis=0) + half, 2.0 * half, distance, frame)


def revolved(frame: Frame, profile: Floats, rounding: float) -> Field:
    """A solid of revolution about the z axis of a frame.

    `profile`, shape (m, 2), is a simple polygon of (radius, height), grown by `rounding`.
    """

    def distance(points: Floats) -> Floats:
        local = frame.local(points)
        flat = np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1)
        return polygon_distance(flat, profile) - rounding

    axis = frame.axes[:, 2]
    ends = frame.origin + np.outer([profile[:, 1].min(), profile[:, 1].max()], axis)
    sideways = float(profile[:, 0].max()) * np.sqrt(np.maximum(1.0 - axis**2, 0.0)) + rounding
    return Field(ends.min(axis=0) - sideways, ends.max(axis=0) + sideways, 2.0 * rounding, distance, frame)


def polygon_distance(points: Floats, outline: Floats) -> Floats:
    """Signed distance, shape (n,), of plane points, shape (n, 2), to a simple polygon, shape (m, 2)."""
    squared = np.full(len(points), np.inf)
    inside = np.zeros(len(points), dtype=bool)
    for a, b in zip(np.roll(outline, 1, axis=0), outline, strict=True):
        edge, offset = b - a, points - a
        along = np.clip(offset @ edge / max(float(edge @ edge), _TINY), 0.0, 1.0)
        gap = offset - along[:, None] * edge
        squared = np.minimum(squared, np.einsum("ij,ij->i", gap, gap))
        if a[1] != b[1]:
            crosses = (points[:, 1] >= a[1]) != (points[:, 1] >= b[1])
            inside ^= crosses & (offset[:, 0] < offset[:, 1] * edge[0] / edge[1])
    signed: Floats = np.where(inside, -1.0, 1.0) * np.sqrt(squared)
    return signed


def _lengths(rows: Floats) -> Floats:
    lengths: Floats = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return lengths


def _axes_along(direction: Floats, across: Floats) -> Floats:
    """Orthonormal columns, shape (3, 3): x along a direction, z as near `across` as that allows."""
    length = float(np.linalg.norm(direction))
    x = direction / length if length > _TINY else np.eye(3)[0]
    z = across - (across @ x) * x
    if np.linalg.norm(z) < 1e-6:
        least = np.eye(3)[np.argmin(np.abs(x))]
        z = least - (least @ x) * x
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)
