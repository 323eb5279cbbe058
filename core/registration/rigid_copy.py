"""Whether one surface is a rigid copy of another or of its mirror image, and its scale, in some milliseconds.

Copies with one tessellation have the same samples in the same order, so their records suffice. Other copies
are registered by ICP from the correspondence and the principal axes, first by rotations, then by reflections.
Where two principal moments are nearly equal, as of a screw or a ring, their axes mean nothing: ICP then also
begins from turns about the third axis.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from core.arrays import Floats
from core.embedding import Embedding
from core.registration.similarity_icp import (
    RESIDUAL,
    Similarity,
    best_similarity,
    closest_pairs,
    rough_alignment,
)
from core.sampling.surface_samples import SurfaceSamples

COPY_SPECTRAL = 0.05
"""Largest spectral distance of two rigid copies; another mesh of a surface moves the eigenvalues. Copies with
half of the vertices have at most 0.005, thin wings on a coarse mesh 0.039."""

STARTING, ROUNDS = 6, 20
"""Largest numbers of coarse iterations from each initial alignment, and of fine iterations."""

GAIN = 0.98
"""Fine iterations end when the residual exceeds this fraction of the one before."""

STRAIGHT, PROMISING, FINE, HOPELESS = 0.01, 0.02, 0.0015, 3.0 * RESIDUAL
"""A coarse alignment with a residual of at most `STRAIGHT`, about the spacing of the sample points, gets fine
iterations at once; of the others the best one does, unless it is above `PROMISING`. Fine iterations end at
`FINE`, or without a copy above `HOPELESS`."""

TIED, TURNS, TURNED = 1.1, 20, 3
"""Largest ratio of two nearly equal principal moments; turns about the third axis, for each of its two
directions; and the number of them, best first, that get fine iterations."""


@dataclass(frozen=True)
class RigidCopy:
    """A surface that is a rigid copy of another one, or of its mirror image.

    Attributes
    ----------
    scale : float
        Length in the copy over length in the other surface, > 0.
    mirrored : bool
        Whether it is a copy of the mirror image and not of the surface: a symmetric surface is both.
    """

    scale: float
    mirrored: bool


def may_be_copy(spectral: float, first_radius: float, second_radius: float) -> bool:
    """Whether eigenvalues and area allow that two surfaces are rigid copies.

    Parameters
    ----------
    spectral : float
        Distance of their log eigenvalues, >= 0.
    first_radius, second_radius : float
        Root mean square distance of each surface from its centroid over the square root of its area. Those of
        two surfaces differ by at most their residual.
    """
    return spectral <= COPY_SPECTRAL and abs(first_radius - second_radius) <= RESIDUAL


def copy_by_samples(first: Embedding, second: Embedding) -> RigidCopy | None:
    """The second surface as a copy of the first, by the samples of two embeddings.

    None unless the samples coincide, in their order, after a rotation and a scaling: surfaces with other
    tessellations have other samples. Samples that coincide after a reflection tell nothing, as the surface
    may be symmetric.
    """
    if len(first.positions) != len(second.positions):
        return None
    source, target = (one.positions.astype(np.float64) for one in (first, second))
    motion = best_similarity(source, target, sign=1, scaled=True)
    gaps = np.linalg.norm(target - motion.apply(source), axis=1)
    near = gaps.max() <= RESIDUAL * np.sqrt(second.facts.area)
    return RigidCopy(motion.scale, mirrored=False) if near else None


def copy_by_surfaces(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats]
) -> RigidCopy | None:
    """The second surface as a copy of the first, by registration; None if it is none.

    Parameters
    ----------
    first, second : SurfaceSamples
    pairs : two of float64, shape (m, 3)
        Corresponding points of both surfaces, in the files' units: the first initial alignment. The principal
        axes give four more.
    """
    for sign in (1, -1):
        motion = _registered(first, second, pairs, sign)
        if motion is not None:
            return RigidCopy(motion.scale * second.unit / first.unit, mirrored=sign < 0)
    return None


def _registered(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats], sign: int
) -> Similarity | None:
    """The transform of a copy, of one sign of the determinant; None if there is none."""
    best, chosen = PROMISING, None
    for start in _starts(first, second, pairs, sign):
        residual, motion = rough_alignment(first, second, start, sign, STARTING)
        if residual <= STRAIGHT:
            found = _refined(first, second, motion, sign)
            if found is not None:
                return found
        elif residual <= best:
            best, chosen = residual, motion
    found = None if chosen is None else _refined(first, second, chosen, sign)
    if found is not None:
        return found
    ends = [
        rough_alignment(first, second, turn, sign, STARTING) for turn in _turned_starts(first, second, sign)
    ]
    ends.sort(key=lambda end: end[0])
    for residual, motion in ends[:TURNED]:
        found = _refined(first, second, motion, sign) if residual <= PROMISING else None
        if found is not None:
            return found
    return None


def _refined(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity, sign: int
) -> Similarity | None:
    """The transform after fine iterations, if it is that of a copy."""
    residual, ours, theirs = closest_pairs(first, second, motion)
    before = np.inf
    for _ in range(ROUNDS):
        if residual > min(HOPELESS, GAIN * before):
            break
        before = residual
        motion = best_similarity(ours, theirs, sign=sign, scaled=True)
        residual, ours, theirs = closest_pairs(first, second, motion)
        if residual <= FINE:
            break
    return motion if residual <= RESIDUAL else None


def _starts(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats], sign: int
) -> list[Similarity]:
    """The alignments of the pairs and of the principal axes."""
    return [
        best_similarity(first.to_unit(pairs[0]), second.to_unit(pairs[1]), sign=sign, scaled=False),
        *(
            Similarity(1.0, second.axes.T * signs @ first.axes, np.zeros(3))
            for signs in product((1.0, -1.0), repeat=3)
            if np.prod(signs) * sign > 0.0
        ),
    ]


def _turned_starts(first: SurfaceSamples, second: SurfaceSamples, sign: int) -> list[Similarity]:
    """Alignments of the principal axes, turned about one if the moments of the other two are nearly equal."""
    moments = (second.points @ second.axes.T).var(axis=0)
    order = np.argsort(moments)
    ratios = moments[order[1:]] / np.maximum(moments[order[:-1]], np.finfo(np.float64).tiny)
    if ratios.min() > TIED:
        return []
    axis = int(order[2] if ratios[0] <= ratios[1] else order[0])
    one, other = (axis + 1) % 3, (axis + 2) % 3
    starts = []
    for direction, angle in product((1.0, -1.0), 2.0 * np.pi / TURNS * np.arange(TURNS)):
        turn = np.eye(3)
        turn[axis, axis] = direction
        turn[one, one], turn[one, other] = np.cos(angle), -np.sin(angle)
        turn[other, one], turn[other, other] = np.sin(angle), np.cos(angle)
        rotation = second.axes.T @ turn @ first.axes
        if np.linalg.det(rotation) * sign < 0.0:
            turn[:, one] *= -1.0
            rotation = second.axes.T @ turn @ first.axes
        starts.append(Similarity(1.0, rotation, np.zeros(3)))
    return starts
