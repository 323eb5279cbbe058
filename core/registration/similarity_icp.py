"""Similarity ICP: the best similarity transform of one surface onto another, and its residual.

S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI
13(4), 1991, with a given sign of the determinant; P. J. Besl, N. D. McKay, "A method for registration of 3-D
shapes", IEEE PAMI 14(2), 1992, from several initial alignments.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from core.arrays import Floats
from core.registration.kinship import SIZE, Kinship, kinship
from core.sampling.surface_samples import SurfaceSamples, closest_points

RESIDUAL = 0.003
"""Largest residual of two copies of one shape, over the square root of the area.

Copies that are rotated, scaled, mirrored, subdivided or simplified to half their vertices have at most
0.0014, synthetic shapes and scans alike; other poses and individuals of the gallery have at least 0.006. The
distances are between surfaces and not between samples, because another meshing moves the samples by their
spacing: between samples the two figures would be 0.037 and 0.044.
"""

STARTING, ROUNDS, FEW = 12, 20, 200
"""Largest number of coarse iterations from each start, of fine iterations from the best start, and the number
of points of a coarse iteration."""

FAR = 0.05
"""Residual of the coarse alignment above which there are no fine iterations."""

GAIN = 0.995
"""Fine iterations end when the residual exceeds this fraction of the best one."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """The similarity transform p -> scale * rotation @ p + shift.

    Attributes
    ----------
    scale : float
        > 0.
    rotation : float64, shape (3, 3)
        Orthogonal; its determinant is 1, or -1 for a reflection.
    shift : float64, shape (3,)
    """

    scale: float
    rotation: Floats
    shift: Floats

    def apply(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.shift)

    def invert(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3), by the inverse."""
        return np.asarray((points - self.shift) @ self.rotation / self.scale)


@dataclass(frozen=True)
class Alignment:
    """The alignment of two surfaces.

    Attributes
    ----------
    residual : float
        Root mean square distance in both directions over the square root of the area, >= 0; an estimate
        above `FAR`.
    scale : float
        Length in the second surface over length in the first.
    mirrored : bool
        Whether the residual of rotations exceeds `RESIDUAL` and a reflection has a smaller one.
    """

    residual: float
    scale: float
    mirrored: bool

    def kinship(self, residual: float = RESIDUAL, size: float = SIZE) -> Kinship | None:
        """Relation of the second surface to the first; None if the alignment exceeds the given residual.

        A mirror image is "mirrored" at any scale.
        """
        return None if self.residual > residual else kinship(self.scale, mirrored=self.mirrored, size=size)


def best_similarity(source: Floats, target: Floats, *, sign: int, scaled: bool) -> Similarity:
    """The least-squares similarity transform of paired points (Umeyama 1991, Eqs. 39 to 43).

    Parameters
    ----------
    source, target : float64, shape (n, 3)
        Row i of the source corresponds to row i of the target.
    sign : int
        Sign of the determinant: 1 for a rotation, -1 for a reflection.
    scaled : bool
        Whether the scale is fitted; else it is 1, as for a source whose points coincide.
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
    """The best similarity transform of one surface onto another, over rotations and reflections.

    Parameters
    ----------
    first, second : SurfaceSamples
    pairs : two of float64, shape (m, 3), or None
        Corresponding points of both surfaces, in the files' units. They give one more initial alignment
        beside those by the principal axes, which may be tied.
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
    """The least residual of transforms with one sign of the determinant, and the transform, at unit areas."""
    starts = [
        Similarity(1.0, second.axes.T * signs @ first.axes, np.zeros(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.prod(signs) == sign
    ]
    if pairs is not None:
        starts.append(
            best_similarity(first.to_unit(pairs[0]), second.to_unit(pairs[1]), sign=sign, scaled=False)
        )
    ends = [rough_alignment(first, second, start, sign) for start in starts]
    rough, motion = min(ends, key=lambda end: end[0])
    if rough > FAR:
        return rough, motion
    residual, ours, theirs = closest_pairs(first, second, motion)
    best = residual, motion
    for _ in range(ROUNDS):
        motion = best_similarity(ours, theirs, sign=sign, scaled=True)
        residual, ours, theirs = closest_pairs(first, second, motion)
        if residual > GAIN * best[0]:
            break
        best = residual, motion
    return best


def rough_alignment(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity, sign: int, iterations: int = STARTING
) -> tuple[float, Similarity]:
    """The residual and the transform after coarse iterations between sample points, without scaling.

    Parameters
    ----------
    first, second : SurfaceSamples
    motion : Similarity
        The initial alignment, between the surfaces at unit area.
    sign : int
        Sign of the determinant: 1 for a rotation, -1 for a reflection.
    iterations : int
        Their largest number.
    """
    few = first.points[:: len(first.points) // FEW]
    gaps, near = second.tree.query(motion.apply(few))
    for _ in range(iterations):
        motion = best_similarity(few, second.points[near], sign=sign, scaled=False)
        before = near
        gaps, near = second.tree.query(motion.apply(few))
        if np.array_equal(near, before):
            break
    return float(np.sqrt((gaps**2).mean())), motion


def closest_pairs(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity
) -> tuple[float, Floats, Floats]:
    """The residual of a transform, and the pairs of closest points, each at its own unit area."""
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
