"""Linear blend skinning: a surface moves with its solids from one pose to another."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array

from core.arrays import Floats, Ints
from core.gallery.fields import Field

_REACH = 0.15
"""Distance beyond a solid in which it moves the surface, over the thickness of the nearest solid."""

_ROUNDS = 6
"""Rounds of averaging of the weights over neighbours: joints bend over a few edges and not over one."""


def skinning_weights(vertices: Floats, faces: Ints, solids: Sequence[Field]) -> Floats:
    """Skinning weights of n vertices and s solids, shape (n, s); rows sum to 1."""
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
    """The rotation of each solid from the rest pose to another pose, shape (s, 3, 3).

    The rotation of a round bone about its axis is arbitrary: it follows the solid at its first joint, and
    then rotates by the least angle that aligns its axis.
    """
    starts = np.array([solid.frame.origin for solid in rest])
    depth = np.stack([solid.distance(starts) for solid in rest])
    found = np.empty((len(rest), 3, 3))
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        if not before.round:
            found[i] = after.frame.axes @ before.frame.axes.T
        else:
            held = found[int(depth[:i, i].argmin())] if i else np.eye(3)
            found[i] = _least_rotation(held @ before.frame.axes[:, 0], after.frame.axes[:, 0]) @ held
    return found


def skinned(vertices: Floats, hold: Floats, rest: Sequence[Field], posed: Sequence[Field]) -> Floats:
    """Vertices of the rest pose, moved to another pose, shape (n, 3); solids have the same order in both."""
    solid_rotations = rotations(rest, posed)
    moved = np.zeros_like(vertices)
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        moved += hold[:, i, None] * (
            (vertices - before.frame.origin) @ solid_rotations[i].T + after.frame.origin
        )
    return moved


def _least_rotation(first: Floats, second: Floats) -> Floats:
    """The rotation by the least angle that takes one unit vector to another (Rodrigues)."""
    axis = np.cross(first, second)
    cosine = float(first @ second)
    if cosine < -1.0 + 1e-9:
        across = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
