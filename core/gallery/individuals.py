"""The true correspondence of two individuals of a class, by the solids that both are made of."""

import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.gallery.bodies import Body
from core.gallery.fields import Field
from core.gallery.skinning import rotations
from core.gallery.symmetry import symmetric_partners

_FLAT = 1e-6
"""Least extent of the vertices of a solid, relative to the largest."""


def individual_partners(first: Body, second: Body) -> Ints:
    """True correspondences of the vertices of one individual on another of its class, shape (g, n).

    Each vertex moves with the solids that hold it (linear blend skinning), and each solid is scaled along its
    own axes to the extents of the same solid of the other individual. The nearest vertex then is the partner:
    where solids blend into each other, it is known to the width of the blend only.

    Returns
    -------
    int64, shape (g, n)
        A row for each symmetry of the class, as of `core.gallery.bodies.Body.partners`.

    Raises
    ------
    ParameterError
        The two are of different classes, or have different solids.
    """
    if first.label != second.label or len(first.solids) != len(second.solids):
        raise ParameterError(f"a {first.label} and a {second.label} have no solids in common")
    moved = np.zeros_like(first.rest.vertices)
    turns = rotations(first.solids, second.solids)
    for i, (before, after) in enumerate(zip(first.solids, second.solids, strict=True)):
        here, there = _extents(before, first, i), _extents(after, second, i)
        ratio = (there / here) if here.min() > _FLAT * here.max() else np.ones(3)
        local = before.frame.local(first.rest.vertices) * ratio
        turned = local @ before.frame.axes.T @ turns[i].T
        moved += first.hold[:, i, None] * (turned + after.frame.origin)
    return symmetric_partners(first.label, moved, second.rest.vertices)


def _extents(solid: Field, body: Body, which: int) -> Floats:
    """Extents of a solid's vertices about its origin along its axes, shape (3,): root mean squares.

    Across a round bone all directions are alike.
    """
    squares = np.average(
        solid.frame.local(body.rest.vertices) ** 2, axis=0, weights=body.hold[:, which] + np.finfo(float).tiny
    )
    if solid.round:
        squares[1:] = squares[1:].mean()
    return np.sqrt(np.asarray(squares))
