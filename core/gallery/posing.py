"""Poses of one body: the random numbers of its proportions and its pose, and linear blend skinning.

A builder draws its numbers one by one and always in the same order, so a class is described by a string
with a letter a draw: `b` belongs to the body, `p` to the pose, and `m` is a length that the builder draws
for each side, taken from the middle of its range so that the body is as symmetric as its class. All draws
after the last letter are of the pose. Skinning moves a surface with its solids from one pose to another.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence
from scipy.sparse import coo_array

from core.arrays import Floats, Ints
from core.gallery.solids import Field

_REACH = 0.15
"""Distance beyond a solid in which it moves the surface, over the thickness of the nearest solid."""

_ROUNDS = 6
"""Rounds of averaging of the weights over neighbours: joints bend over a few edges and not over one."""


def at_rest(low: float, high: float) -> float:
    """Return a pose's number at rest: 0 if the range contains it, else the middle of the range."""
    return 0.0 if low < 0.0 < high else 0.5 * (low + high)


class BodyDraws(Generator):
    """Random numbers of a builder: one stream for the body, and another one, or rest values, for the pose.

    `kinds` has a letter for each number, as the module describes, and `rest` values by index where the rule
    of `at_rest` would not separate the limbs; no `pose` gives the rest pose. With a `variation` the body's
    numbers are the middles of their ranges times normal numbers of mean 1 and this standard deviation:
    similar individuals instead of individuals from the whole class.
    """

    def __init__(
        self,
        kinds: str,
        rest: Mapping[int, float],
        body: SeedSequence,
        pose: SeedSequence | None,
        variation: float | None = None,
    ) -> None:
        super().__init__(PCG64(body))
        self._kinds, self._rest = kinds, rest
        self._variation = variation
        self._pose = None if pose is None else Generator(PCG64(pose))
        self._index = 0

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:  # type: ignore[override]
        """Return the next number, uniform in [low, high) unless the body has a variation."""
        index, self._index = self._index, self._index + 1
        kind = self._kinds[index] if index < len(self._kinds) else "p"
        if kind == "b" and self._variation is not None:
            return 0.5 * (low + high) * super().normal(1.0, self._variation)
        if kind == "b":
            return super().uniform(low, high)
        if kind == "m":
            return 0.5 * (low + high)
        if self._pose is not None:
            return self._pose.uniform(low, high)
        return self._rest.get(index, at_rest(low, high))


def skinning_weights(vertices: Floats, faces: Ints, solids: Sequence[Field]) -> Floats:
    """Return the skinning weights of n vertices and s solids, shape (n, s); rows sum to 1."""
    gaps = np.maximum(np.stack([solid.distance(vertices) for solid in solids], axis=1), 0.0)
    nearest = gaps.argmin(axis=1)
    reach = _REACH * np.array([solid.thickness for solid in solids])[nearest]
    beyond = (gaps - gaps.min(axis=1, keepdims=True)) / reach[:, None]
    hold = np.exp(-(beyond**2))
    hold /= hold.sum(axis=1, keepdims=True)
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(len(vertices),) * 2).tocsr()
    degree = graph.sum(axis=1)[:, None]
    for _ in range(_ROUNDS):
        hold = 0.5 * hold + 0.5 * (graph @ hold) / degree
    return np.asarray(hold)


def rotations(rest: Sequence[Field], posed: Sequence[Field]) -> Floats:
    """Return the rotation of each solid from the rest pose to another pose, shape (s, 3, 3).

    The rotation of a round bone about its axis is arbitrary: it follows the solid at its first joint, and
    then rotates by the least angle that aligns its axis.
    """
    starts = np.array([solid.frame.origin for solid in rest])
    depth = np.stack([solid.distance(starts) for solid in rest])
    solid_rotations = np.empty((len(rest), 3, 3))
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        if not before.round:
            solid_rotations[i] = after.frame.axes @ before.frame.axes.T
        else:
            held = solid_rotations[int(depth[:i, i].argmin())] if i else np.eye(3)
            solid_rotations[i] = (
                _least_rotation(held @ before.frame.axes[:, 0], after.frame.axes[:, 0]) @ held
            )
    return solid_rotations


def skinned(vertices: Floats, hold: Floats, rest: Sequence[Field], posed: Sequence[Field]) -> Floats:
    """Return the vertices of the rest pose in another pose, shape (n, 3); the order of solids is the same."""
    solid_rotations = rotations(rest, posed)
    moved = np.zeros_like(vertices)
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        moved += hold[:, i, None] * (
            (vertices - before.frame.origin) @ solid_rotations[i].T + after.frame.origin
        )
    return moved


def _least_rotation(first: Floats, second: Floats) -> Floats:
    """Return the rotation by the least angle that takes one unit vector to another (Rodrigues)."""
    axis = np.cross(first, second)
    cosine = float(first @ second)
    if cosine < -1.0 + 1e-9:
        across = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
