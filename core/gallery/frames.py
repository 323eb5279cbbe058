"""Frames and chains of bones: forward kinematics for the gallery's builders."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, radians, sin
from typing import Literal

import numpy as np

from core.arrays import Floats


def rotation(axis: Literal["x", "y", "z"], degrees: float) -> Floats:
    """Matrix, shape (3, 3), of the right-handed rotation about a coordinate axis."""
    c, s = cos(radians(degrees)), sin(radians(degrees))
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix


@dataclass(frozen=True, eq=False)
class Frame:
    """A place and three orthonormal directions.

    In the world x points to a creature's front, y to its left and z up. A bone lies along its frame's x.

    Attributes
    ----------
    origin : float64, shape (3,)
    axes : float64, shape (3, 3)
        The columns are the frame's own x, y and z in the world.
    """

    origin: Floats = field(default_factory=lambda: np.zeros(3))
    axes: Floats = field(default_factory=lambda: np.eye(3))

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Floats:
        """World position, shape (3,), of a point given in this frame."""
        offset: Floats = self.axes @ np.array([x, y, z])
        return self.origin + offset

    def local(self, points: Floats) -> Floats:
        """World positions, shape (n, 3), as seen in this frame."""
        seen: Floats = (points - self.origin) @ self.axes
        return seen

    def move(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Frame":
        """The frame moved along its own axes."""
        return Frame(self.at(x, y, z), self.axes)

    def rotate(self, axis: Literal["x", "y", "z"], degrees: float) -> "Frame":
        """The frame rotated about one of its own axes, right-handed: y lowers the x axis, z takes it left."""
        return Frame(self.origin, self.axes @ rotation(axis, degrees))


def chain(
    frame: Frame, lengths: Sequence[float], bends: Sequence[tuple[float, float]]
) -> tuple[Floats, Frame]:
    """Bones laid end to end.

    Parameters
    ----------
    frame : Frame
        Of the first joint.
    lengths : sequence of m floats
        Of the bones, each along the x of its frame.
    bends : sequence of m pairs
        Degrees about y and then about z at the joint before each bone.

    Returns
    -------
    joints : float64, shape (m + 1, 3)
    end : Frame
        At the far end of the last bone, directed as that bone.
    """
    joints = [frame.origin]
    for length, (pitch, yaw) in zip(lengths, bends, strict=True):
        frame = frame.rotate("y", pitch).rotate("z", yaw).move(length)
        joints.append(frame.origin)
    return np.array(joints), frame
