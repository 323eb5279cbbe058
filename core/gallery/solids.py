"""Solids by their signed distances: frames and chains of bones, fields, and the parts that builders join.

A signed distance is negative inside and positive outside. Distances are exact for boxes, plates and solids
of revolution. The others are accurate to first order near the surface, which suffices for an isosurface.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import cos, radians, sin
from typing import Literal

import numpy as np

from core.arrays import Floats

_TINY = 1e-12
"""Replaces a length of zero in a denominator."""


def rotation(axis: Literal["x", "y", "z"], degrees: float) -> Floats:
    """Return the matrix, shape (3, 3), of the right-handed rotation about a coordinate axis."""
    c, s = cos(radians(degrees)), sin(radians(degrees))
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix


@dataclass(frozen=True, eq=False)
class Frame:
    """A place, shape (3,), and three orthonormal directions: columns of `axes`, the frame's own x, y and z.

    In the world x points to a creature's front, y to its left and z up. A bone lies along its frame's x.
    """

    origin: Floats = field(default_factory=lambda: np.zeros(3))
    axes: Floats = field(default_factory=lambda: np.eye(3))

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Floats:
        """Return the world position, shape (3,), of a point given in this frame."""
        offset: Floats = self.axes @ np.array([x, y, z])
        return self.origin + offset

    def points(self, *offsets: tuple[float, ...]) -> Floats:
        """Return the world positions, shape (m, 3), of points of up to three coordinates in this frame."""
        return np.array([self.at(*offset) for offset in offsets])

    def local(self, points: Floats) -> Floats:
        """Return world positions, shape (n, 3), as seen in this frame."""
        local: Floats = (points - self.origin) @ self.axes
        return local

    def move(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Frame":
        """Return the frame moved along its own axes."""
        return Frame(self.at(x, y, z), self.axes)

    def rotate(self, axis: Literal["x", "y", "z"], degrees: float) -> "Frame":
        """Return the frame rotated about one of its own axes: y lowers the x axis, z takes it left."""
        return Frame(self.origin, self.axes @ rotation(axis, degrees))


def chain(
    frame: Frame, lengths: Sequence[float], bends: Sequence[tuple[float, float]]
) -> tuple[Floats, Frame]:
    """Lay m bones end to end, each along the x of its frame, from the frame of the first joint.

    A bend has the degrees about y and then about z at the joint before its bone. Return the joints, shape
    (m + 1, 3), and the frame at the far end of the last bone, directed as that bone.
    """
    joints = [frame.origin]
    for length, (pitch, yaw) in zip(lengths, bends, strict=True):
        frame = frame.rotate("y", pitch).rotate("z", yaw).move(length)
        joints.append(frame.origin)
    return np.array(joints), frame


@dataclass(frozen=True, eq=False)
class Field:
    """A solid by its signed distance, a function of points, shape (n, 3).

    `low` and `high`, shape (3,), are corners of a box around it, and `thickness` is its least extent, which a
    grid must resolve. Its own `frame` moves with it; that of a bone is at its start, with x along the bone.
    `round` tells whether it is rotationally symmetric about that axis.
    """

    low: Floats
    high: Floats
    thickness: float
    distance: Callable[[Floats], Floats]
    frame: Frame
    round: bool = False


def capsule(start: Floats, end: Floats, radii: tuple[float, float], across: Floats, squash: float) -> Field:
    """Return a rounded bone whose radius goes linearly from one end to the other.

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


@dataclass(frozen=True, eq=False)
class Part:
    """A plain union of fields, joined to the parts before it by a smooth minimum of radius `blend`."""

    fields: tuple[Field, ...]
    blend: float


def tube(
    joints: Floats | Sequence[Floats],
    radii: Sequence[float] | Floats,
    *,
    blend: float,
    across: Floats | None = None,
    squash: float = 1.0,
) -> Part:
    """Return capsules along a polyline of m joints, shape (m, 3), `squash` times thinner along `across`."""
    direction = np.array([0.0, 0.0, 1.0]) if across is None else across
    bones = zip(joints[:-1], joints[1:], radii[:-1], radii[1:], strict=True)
    return Part(tuple(capsule(a, b, (float(r), float(s)), direction, squash) for a, b, r, s in bones), blend)


def ellipsoid(frame: Frame, radii: tuple[float, float, float], *, blend: float) -> Part:
    """Return an ellipsoid centred on a frame, with semi-axes along the axes of the frame."""
    semi_axes = np.array(radii)
    least = float(semi_axes.min())

    def distance(points: Floats) -> Floats:
        scaled = frame.local(points) / semi_axes
        level, slope = _lengths(scaled), _lengths(scaled / semi_axes)
        return np.where(level > 1e-6, level * (level - 1.0) / np.maximum(slope, _TINY), -least)

    reach = np.linalg.norm(frame.axes * semi_axes, axis=1)
    return Part((Field(frame.origin - reach, frame.origin + reach, 2.0 * least, distance, frame),), blend)


def box(frame: Frame, size: tuple[float, float, float], *, rounding: float, blend: float) -> Part:
    """Return a box of full extents `size` centred on a frame, with edges rounded by <= min(size) / 2."""
    half = np.array(size) / 2.0

    def distance(points: Floats) -> Floats:
        beyond = np.abs(frame.local(points)) - (half - rounding)
        inside: Floats = np.minimum(beyond.max(axis=1), 0.0)
        return _lengths(np.maximum(beyond, 0.0)) + inside - rounding

    reach = np.abs(frame.axes) @ half
    solid = Field(frame.origin - reach, frame.origin + reach, 2.0 * float(half.min()), distance, frame)
    return Part((solid,), blend)


def plate(frame: Frame, outline: Sequence[tuple[float, float]], thickness: float, *, blend: float) -> Part:
    """Return a fin: a simple polygon in the x, y plane of a frame, grown by half the thickness all round."""
    polygon, half = np.array(outline), thickness / 2.0

    def distance(points: Floats) -> Floats:
        local = frame.local(points)
        sideways = np.maximum(polygon_distance(local[:, :2], polygon), 0.0)
        return np.hypot(sideways, local[:, 2]) - half

    corners = frame.origin + polygon @ frame.axes[:, :2].T
    low, high = corners.min(axis=0) - half, corners.max(axis=0) + half
    return Part((Field(low, high, 2.0 * half, distance, frame),), blend)


def revolved(
    frame: Frame, profile: Sequence[tuple[float, float]] | Floats, rounding: float, *, blend: float
) -> Part:
    """Return a solid of revolution about the z axis of a frame.

    `profile`, shape (m, 2), is a simple polygon of (radius, height), grown by `rounding`.
    """
    polygon = np.array(profile)

    def distance(points: Floats) -> Floats:
        local = frame.local(points)
        flat = np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1)
        return polygon_distance(flat, polygon) - rounding

    axis = frame.axes[:, 2]
    ends = frame.origin + np.outer([polygon[:, 1].min(), polygon[:, 1].max()], axis)
    sideways = float(polygon[:, 0].max()) * np.sqrt(np.maximum(1.0 - axis**2, 0.0)) + rounding
    low, high = ends.min(axis=0) - sideways, ends.max(axis=0) + sideways
    return Part((Field(low, high, 2.0 * rounding, distance, frame),), blend)


def mirrored(outline: Sequence[tuple[float, float]], left: int) -> list[tuple[float, float]]:
    """Return an outline drawn for the left side, or its mirror image when `left` is -1."""
    return [(x, left * y) for x, y in outline]


def polygon_distance(points: Floats, outline: Floats) -> Floats:
    """Return signed distances, shape (n,), of points, shape (n, 2), to a simple polygon, shape (m, 2)."""
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
    """Return orthonormal columns, shape (3, 3): x along a direction, z as near `across` as that allows."""
    length = float(np.linalg.norm(direction))
    x = direction / length if length > _TINY else np.eye(3)[0]
    z = across - (across @ x) * x
    if np.linalg.norm(z) < 1e-6:
        least = np.eye(3)[np.argmin(np.abs(x))]
        z = least - (least @ x) * x
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)
