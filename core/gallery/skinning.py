"""A surface that follows the solids it was made of from one pose to another: linear blend skinning."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array

from core.arrays import Floats, Ints
from core.gallery.fields import Field

_REACH = 0.15
"""How far beyond a solid its hold on the surface goes, as a part of the nearest solid's thickness."""

_ROUNDS = 6
"""Rounds of averaging over neighbours that the weights get: joints bend over a few edges, not over one."""


def weights(vertices: Floats, faces: Ints, solids: Sequence[Field]) -> Floats:
    """How much each solid moves each vertex, shape (n, s): rows sum to 1."""
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


def turns(rest: Sequence[Field], posed: Sequence[Field]) -> Floats:
    """The rotation of each solid from one pose to the other, shape (s, 3, 3).

    A round bone may be turned about itself as one likes: it turns as the solid that holds its first joint
    does, and then by the least angle that brings it into line.
    """
    starts = np.array([solid.frame.origin for solid in rest])
    depth = np.stack([solid.distance(starts) for solid in rest])
    found = np.empty((len(rest), 3, 3))
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        if not before.round:
            found[i] = after.frame.axes @ before.frame.axes.T
        else:
            held = found[int(depth[:i, i].argmin())] if i else np.eye(3)
            found[i] = _least_turn(held @ before.frame.axes[:, 0], after.frame.axes[:, 0]) @ held
    return found


def skinned(vertices: Floats, hold: Floats, rest: Sequence[Field], posed: Sequence[Field]) -> Floats:
    """The vertices of the rest pose, shape (n, 3), in another; the solids are the same in the same order."""
    rotations = turns(rest, posed)
    moved = np.zeros_like(vertices)
    for i, (before, after) in enumerate(zip(rest, posed, strict=True)):
        moved += hold[:, i, None] * ((vertices - before.frame.origin) @ rotations[i].T + after.frame.origin)
    return moved


def _least_turn(first: Floats, second: Floats) -> Floats:
    """The rotation by the least angle that takes one unit vector to another (Rodrigues)."""
    axis = np.cross(first, second)
    cosine = float(first @ second)
    if cosine < -1.0 + 1e-9:
        across = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
