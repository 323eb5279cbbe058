"""One body in several poses: every pose has the same vertices in the same order.

`make_shape` makes another individual each time. `make_body` meshes a body once, at rest, and skinning moves
the mesh with its solids, so vertex i of one pose corresponds to vertex i of another. Two individuals of a
class correspond by the solids that both are made of.

At rest a creature looks along x, y is its left and z is up. A hand and pliers stand upright, so that x is
across the palm and the flat of the jaws. Deviations from the listed symmetries (the eyes of an octopus, the
position of a thumb) are smaller than the thickness of the limbs.
"""

from dataclasses import dataclass
from itertools import product
from zlib import crc32

import numpy as np
from numpy.random import SeedSequence, default_rng
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.errors import MeshError, ParameterError
from core.gallery.collection import CLASSES, KINDS, placed
from core.gallery.posing import BodyDraws, rotations, skinned, skinning_weights
from core.gallery.solids import Field, rotation
from core.gallery.surface import genus, surface
from core.mesh.mesh import Mesh

VERTICES = 2500
_ATTEMPTS = 25
_LEAST_EXTENT = 1e-6
"""Least extent of the vertices of a solid, relative to the largest."""

_SIDES = np.diag([1.0, -1.0, 1.0])
_FLAT = np.diag([-1.0, 1.0, 1.0])
_UPSIDE = np.diag([1.0, 1.0, -1.0])
_ARMS = 8

_OCTOPUS = [
    rotation("z", 360.0 / _ARMS * turn) @ mirror
    for turn, mirror in product(range(_ARMS), (np.eye(3), _SIDES))
]

_BOTH = {
    "hand": [np.eye(3), _FLAT],
    "octopus": _OCTOPUS,
    "pliers": [np.eye(3), _SIDES, _FLAT, _FLAT @ _SIDES],
    "snake": [np.eye(3), _SIDES, _UPSIDE, _UPSIDE @ _SIDES],
}


@dataclass(frozen=True, eq=False)
class Body:
    """An individual of a class, with the data for its poses.

    The mesh at `rest`, limbs apart, is in the builder's frame, watertight, connected, of about 2,500
    vertices; `solids` are those at rest. `hold`, shape (n, number of solids), has the skinning weights of the
    vertices; rows sum to 1. `seeds` are those of the body's random numbers, and `variation` is that of
    `make_body`.
    """

    label: str
    rest: Mesh
    solids: tuple[Field, ...]
    hold: Floats
    seeds: tuple[int, ...]
    variation: float | None = None

    def partners(self, other: "Body") -> Ints:
        """Return the true correspondences of the vertices on a mesh of the same body, shape (g, n).

        Each row belongs to a symmetry and is a correspondence of two poses, to within half an edge. On the
        same mesh the first row is 0 .. n - 1.
        """
        return symmetric_partners(self.label, self.rest.vertices, other.rest.vertices)

    def posed(self, pose: int) -> Mesh:
        """Return the body in a pose, with random rotation, scale and position; the faces are those at rest.

        Limbs may intersect, which changes no distance on the surface. Raise ParameterError for a pose < 0.
        """
        if pose < 0:
            raise ParameterError(f"the pose must be at least 0, not {pose}")
        solids = _solids(self, pose)
        moved = skinned(self.rest.vertices, self.hold, self.solids, solids)
        return Mesh(placed(moved, default_rng([*self.seeds, pose, 1])), self.rest.faces)


def make_body(label: str, body: int = 0, *, vertices: int = VERTICES, variation: float | None = None) -> Body:
    """Return an individual >= 0 of a class; its proportions depend on label, number and variation only.

    The mesh has about so many vertices, at least some hundreds; another number gives another mesh of the
    body. `variation` > 0 is the coefficient of variation of the proportions: how much individuals differ, who
    have the middle proportions of their class in the mean. Without it they are drawn from the whole class.
    Raise ParameterError if the class is unknown or the number is negative.
    """
    if label not in CLASSES:
        raise ParameterError(f"unknown class {label!r}; the classes are {', '.join(CLASSES)}")
    if body < 0:
        raise ParameterError(f"the body must be at least 0, not {body}")
    kind = KINDS[label]
    for attempt in range(_ATTEMPTS):
        seeds = (crc32(label.encode()), body, attempt)
        parts = kind.build(BodyDraws(kind.draws, kind.rest, SeedSequence(seeds), None, variation))
        points, faces = surface(parts, vertices)
        if genus(faces) == kind.handles:
            solids = tuple(solid for part in parts for solid in part.fields)
            return Body(
                label=label,
                rest=Mesh(points, faces),
                solids=solids,
                hold=skinning_weights(points, faces, solids),
                seeds=seeds,
                variation=variation,
            )
    raise MeshError(f"no sound body of class {label} in {_ATTEMPTS} draws")


def _solids(body: Body, pose: int) -> list[Field]:
    kind = KINDS[body.label]
    seeds = SeedSequence(body.seeds), SeedSequence([*body.seeds, pose])
    draws = BodyDraws(kind.draws, kind.rest, *seeds, body.variation)
    return [solid for part in kind.build(draws) for solid in part.fields]


def individual_partners(first: Body, second: Body) -> Ints:
    """Return the true correspondences of one individual's vertices on another of its class, shape (g, n).

    Each vertex moves with the solids that hold it (linear blend skinning), and each solid is scaled along its
    own axes to the extents of the same solid of the other individual. The nearest vertex then is the partner:
    where solids blend into each other, it is known to the width of the blend only. There is a row for each
    symmetry of the class, as of `Body.partners`. Raise ParameterError for two classes or different solids.
    """
    if first.label != second.label or len(first.solids) != len(second.solids):
        raise ParameterError(f"a {first.label} and a {second.label} have no solids in common")
    moved = np.zeros_like(first.rest.vertices)
    turns = rotations(first.solids, second.solids)
    for i, (before, after) in enumerate(zip(first.solids, second.solids, strict=True)):
        sizes, wanted = _extents(before, first, i), _extents(after, second, i)
        ratio = (wanted / sizes) if sizes.min() > _LEAST_EXTENT * sizes.max() else np.ones(3)
        local = before.frame.local(first.rest.vertices) * ratio
        turned = local @ before.frame.axes.T @ turns[i].T
        moved += first.hold[:, i, None] * (turned + after.frame.origin)
    return symmetric_partners(first.label, moved, second.rest.vertices)


def _extents(solid: Field, body: Body, which: int) -> Floats:
    """Return the root mean squares of a solid's vertices along its axes, shape (3,).

    Across a round bone all directions are alike.
    """
    squares = np.average(
        solid.frame.local(body.rest.vertices) ** 2, axis=0, weights=body.hold[:, which] + np.finfo(float).tiny
    )
    if solid.round:
        squares[1:] = squares[1:].mean()
    return np.sqrt(np.asarray(squares))


def symmetries(label: str) -> Floats:
    """Return the orthogonal maps of a body at rest onto itself, the identity first, shape (g, 3, 3).

    Left and right for every class but the hand, whose palm and back are alike; pliers are alike from both
    faces too, a snake from above and below, and an octopus from each of its eight arms.
    """
    return np.array(_BOTH.get(label, [np.eye(3), _SIDES]))


def symmetric_partners(label: str, vertices: Floats, rest: Floats) -> Ints:
    """Return the vertex of a body at rest nearest to each point's image under each symmetry, shape (g, n).

    The points are vertices of a mesh of the same body at rest, this one or another. The first row belongs to
    the identity.
    """
    tree = cKDTree(rest)
    return np.array([tree.query(vertices @ turn.T)[1] for turn in symmetries(label)], dtype=np.int64)
