"""Whether two surfaces are one rigid form: the best similarity of one onto the other, and what it leaves.

S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI
13(4), 1991, with the sign of the determinant given; and P. J. Besl, N. D. McKay, "A method for registration
of 3-D shapes", IEEE PAMI 14(2), 1992, from several starts.
"""

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from core.arrays import Floats
from core.sampling.surface_samples import SurfaceSamples, closest_points

Kinship = Literal["same", "scaled", "mirrored"]

RESIDUAL = 0.003
"""Two surfaces are one form where no more than this is left, over the root of the area.

Copies that are turned, scaled, mirrored, split or simplified to half their vertices leave at most 0.0014,
made shapes and scanned ones alike; other poses and individuals of the gallery at least 0.006. With the
samples' positions alone it is 0.037 and 0.044, as another meshing moves the samples by their own spacing; so
the surfaces themselves are laid onto each other.
"""

SIZE = 0.03
"""They are of one size where the factor between them differs from 1 by no more than this."""

STARTING, ROUNDS, FEW = 12, 20, 200
"""Most rounds from each start, with so few points; and most with all, from the best of each sign."""

FAR = 0.05
"""Where the few points stay farther apart than this, no more rounds are made."""

GAIN = 0.995
"""Rounds end where the residual does not fall below this part of itself."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """p becomes `scale` * `rotation` @ p + `shift`: `rotation` is orthogonal, of determinant 1 or -1."""

    scale: float
    rotation: Floats
    shift: Floats

    def apply(self, points: Floats) -> Floats:
        """Points, shape (n, 3), moved."""
        return np.asarray(self.scale * points @ self.rotation.T + self.shift)

    def invert(self, points: Floats) -> Floats:
        """Points, shape (n, 3), moved back."""
        return np.asarray((points - self.shift) @ self.rotation / self.scale)


@dataclass(frozen=True)
class Alignment:
    """How near one surface comes to another.

    Attributes
    ----------
    residual : float
        Root mean square distance, both ways, over the root of the area; >= 0. Above `FAR` it is roughly that.
    scale : float
        Length in the second over length in the first.
    mirrored : bool
        Whether a reflection comes nearer, beyond `RESIDUAL`, than all rotations.
    """

    residual: float
    scale: float
    mirrored: bool

    def kinship(self, residual: float = RESIDUAL, size: float = SIZE) -> Kinship | None:
        """What the second is to the first; None where more than the residual is left.

        A mirror image is "mirrored" in any size.
        """
        return None if self.residual > residual else kinship(self.scale, mirrored=self.mirrored, size=size)


def kinship(scale: float, *, mirrored: bool, size: float = SIZE) -> Kinship:
    """What a form of another scale, and perhaps mirrored, is to the first."""
    if mirrored:
        return "mirrored"
    return "same" if max(scale, 1.0 / scale) <= 1.0 + size else "scaled"


def best_similarity(source: Floats, target: Floats, *, sign: int, scaled: bool) -> Similarity:
    """The least-squares similarity of paired points (Umeyama 1991, Eqs. 39 to 43).

    Parameters
    ----------
    source, target : float64, shape (n, 3)
        Row i of one belongs to row i of the other.
    sign : int
        Of the determinant: 1 for a rotation, -1 for a reflection.
    scaled : bool
        Whether the scale is fitted too; it is 1 otherwise, and where the source is one point.
    """
    here, there = source.mean(axis=0), target.mean(axis=0)
    centred = source - here
    left, values, right = np.linalg.svd((target - there).T @ centred / len(source))
    signs = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left * signs @ right
    variance = float((centred**2).sum() / len(source))
    scale = float(values @ signs) / variance if scaled and variance > 0.0 else 1.0
    return Similarity(scale, rotation, there - scale * rotation @ here)


def align(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats] | None = None
) -> Alignment:
    """The best similarity of one surface onto another, rotations and reflections alike.

    Parameters
    ----------
    first, second : SurfaceSamples
    pairs : two of float64, shape (m, 3), or None
        Points of each that correspond, in the file's units: a start beside the principal axes, which may be
        tied.
    """
    residual, motion = _nearest(first, second, pairs, 1)
    mirrored = False
    if residual > RESIDUAL:
        reflected, reflection = _nearest(first, second, pairs, -1)
        if reflected < residual:
            residual, motion, mirrored = reflected, reflection, True
    return Alignment(residual, motion.scale * second.unit / first.unit, mirrored)


def _nearest(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats] | None, sign: int
) -> tuple[float, Similarity]:
    """The least residual that motions of one sign come to, and the motion, at unit areas."""
    starts = [
        Similarity(1.0, second.axes.T * signs @ first.axes, np.zeros(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.prod(signs) == sign
    ]
    if pairs is not None:
        starts.append(
            best_similarity(first.to_unit(pairs[0]), second.to_unit(pairs[1]), sign=sign, scaled=False)
        )
    ends = [_rough_alignment(first, second, start, sign) for start in starts]
    rough, motion = min(ends, key=lambda end: end[0])
    if rough > FAR:
        return rough, motion
    residual, ours, theirs = _closest_pairs(first, second, motion)
    best = residual, motion
    for _ in range(ROUNDS):
        motion = best_similarity(ours, theirs, sign=sign, scaled=True)
        residual, ours, theirs = _closest_pairs(first, second, motion)
        if residual > GAIN * best[0]:
            break
        best = residual, motion
    return best


def _rough_alignment(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity, sign: int
) -> tuple[float, Similarity]:
    """A start after some rounds of the closest of the points, and how far these then are apart."""
    few = first.points[:: len(first.points) // FEW]
    gaps, near = second.tree.query(motion.apply(few))
    for _ in range(STARTING):
        motion = best_similarity(few, second.points[near], sign=sign, scaled=False)
        before = near
        gaps, near = second.tree.query(motion.apply(few))
        if np.array_equal(near, before):
            break
    return float(np.sqrt((gaps**2).mean())), motion


def _closest_pairs(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity
) -> tuple[float, Floats, Floats]:
    """The residual of a motion, and the points of both that it brings closest, in their own places."""
    ours, theirs = first.representatives, second.representatives
    there = closest_points(second, motion.apply(ours))
    back = closest_points(first, motion.invert(theirs))
    ahead = ((motion.apply(ours) - there) ** 2).sum(axis=1).mean()
    behind = ((motion.invert(theirs) - back) ** 2).sum(axis=1).mean()
    return (
        float(np.sqrt(0.5 * (ahead + behind))),
        np.concatenate([ours, back]),
        np.concatenate([there, theirs]),
    )
