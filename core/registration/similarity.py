"""The similarity transform of paired points, and of surfaces that are rigid copies in large part.

S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI
13(4), 1991, with a given sign of the determinant.

Of two surfaces that are rigid copies in large part only, a part that is missing, added or bent must not pull
the rest: of the closest pairs only the nearest share counts (trimmed ICP; D. Chetverikov, D. Svirko, D.
Stepanov and P. Krsek, "The trimmed iterative closest point algorithm", ICPR 2002).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from core.arrays import Floats
from core.sampling.surface_samples import SurfaceSamples, closest_points

RESIDUAL = 0.003
"""Largest root mean square distance of two copies of one shape, over the square root of the area.

Copies that are rotated, scaled, mirrored, subdivided or simplified to half their vertices have at most
0.0014, synthetic shapes and scans alike; other poses and individuals of the gallery have at least 0.006. The
distances are between surfaces and not between samples, because another meshing moves the samples by their
spacing: between samples the two figures would be 0.037 and 0.044.
"""

SHARE = 0.7
"""Share of either surface that must lie on the other."""

FEW, FIRST_ROUNDS, COARSE_ROUNDS, ROUNDS = 200, 5, 20, 8
"""Sample points of a coarse iteration, and the largest numbers of first coarse iterations, of further
ones and of fine iterations."""

FIRST_RESIDUAL, COARSE_RESIDUAL, RESIDUAL_RATIO = 0.025, 0.02, 2.0
"""Largest residuals, between sample points, of an alignment that is kept after the first and after all coarse
iterations; and its largest ratio to the least residual."""

NEAR = 3.0 * RESIDUAL
"""Distance over the root of the area within which a point lies on the other surface."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """The similarity transform p -> scale * rotation @ p + shift, scale > 0.

    The rotation, shape (3, 3), is orthogonal; its determinant is 1, or -1 for a reflection.
    """

    scale: float
    rotation: Floats
    shift: Floats

    def apply(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.shift)

    def then(self, other: "Similarity") -> "Similarity":
        """Return the transform that applies this one first and another one to its result."""
        return Similarity(
            other.scale * self.scale,
            other.rotation @ self.rotation,
            other.scale * other.rotation @ self.shift + other.shift,
        )

    @property
    def inverse(self) -> "Similarity":
        """The inverse transform."""
        scale = 1.0 / self.scale
        return Similarity(scale, self.rotation.T, -scale * self.shift @ self.rotation)

    def invert(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3), by the inverse."""
        return np.asarray((points - self.shift) @ self.rotation / self.scale)

    @property
    def matrix(self) -> Floats:
        """The matrix of the transform in homogeneous coordinates, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.scale * self.rotation, self.shift
        return matrix


def best_similarity(source: Floats, target: Floats, *, sign: int, scaled: bool) -> Similarity:
    """Return the least-squares similarity transform of paired points (Umeyama 1991, Eqs. 39 to 43).

    Row i of the source, shape (n, 3), corresponds to row i of the target. The determinant has the sign: 1 for
    a rotation, -1 for a reflection. The scale is 1 unless it is fitted, or where the points of the source
    coincide.
    """
    source_centre, target_centre = source.mean(axis=0), target.mean(axis=0)
    centred = source - source_centre
    left, values, right = np.linalg.svd((target - target_centre).T @ centred / len(source))
    signs = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left * signs @ right
    variance = float((centred**2).sum() / len(source))
    scale = float(values @ signs) / variance if scaled and variance > 0.0 else 1.0
    return Similarity(scale, rotation, target_centre - scale * rotation @ source_centre)


def similarity_of(matrix: Floats) -> Similarity:
    """Return the transform of a matrix in homogeneous coordinates, shape (4, 4)."""
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    return Similarity(scale, matrix[:3, :3] / scale, matrix[:3, 3])


def to_unit_area(samples: SurfaceSamples) -> Similarity:
    """Return the transform from the file's coordinates to unit area."""
    return Similarity(1.0 / samples.unit, np.eye(3), -samples.centre / samples.unit)


def bend(source: Floats, target: Floats) -> float:
    """Return how far a correspondence is from a similarity transform, of either sign.

    The result is the distance of `trimmed_similarity`: of a rigid part it is about the distance of samples,
    of a body in another pose more.
    """
    return trimmed_similarity(source, target)[1]


def trimmed_similarity(source: Floats, target: Floats) -> tuple[Similarity, float]:
    """Return the similarity transform of either sign of the nearest `SHARE` of the pairs, and a distance.

    The transform is that of trimmed least squares, row i of the source, shape (n, 3), with row i of the
    target. Nine of ten pairs keep the distance, in the units of the target.
    """
    fits = []
    last = int(SHARE * (len(source) - 1))
    for sign in (1, -1):
        near = np.ones(len(source), dtype=bool)
        for _ in range(ROUNDS):
            motion = best_similarity(source[near], target[near], sign=sign, scaled=True)
            gaps = np.linalg.norm(target - motion.apply(source), axis=1)
            nearest = gaps <= np.partition(gaps, last)[last]
            if np.array_equal(nearest, near):
                break
            near = nearest
        fits.append((motion, float(np.quantile(gaps, 0.9))))
    return min(fits, key=lambda fit: fit[1])


def near_rigid(
    first: SurfaceSamples,
    second: SurfaceSamples,
    pairs: tuple[Floats, Floats],
    same_units: float,
    *,
    sure: bool = False,
) -> Similarity | None:
    """Return the similarity transform of the first surface onto the second, both at unit area.

    Parameters
    ----------
    first, second : SurfaceSamples
    pairs : two of float64, shape (m, 3)
        Corresponding points of both surfaces, in the units of the sampled meshes; some may be wrong. They
        give one initial rotation, the principal axes four more.
    sure : bool
        Whether the pairs are right; they alone then give the initial rotation.
    same_units : float
        Scale of the transform if both files have one unit. The other initial scale makes the areas equal:
        a part that is missing changes the area, another unit changes the lengths.

    Returns
    -------
    Similarity or None
        None unless `SHARE` of either surface lies on the other, with a root mean square distance of at most
        `RESIDUAL` over the root of the area.
    """
    ends = first.to_unit(pairs[0]), second.to_unit(pairs[1])
    rotations = [best_similarity(*ends, sign=1, scaled=False).rotation]
    if not sure:
        signs = (np.array(each) for each in product((1.0, -1.0), repeat=3) if np.prod(each) > 0)
        rotations += [second.axes.T * each @ first.axes for each in signs]
    scales = [1.0] if abs(same_units - 1.0) < RESIDUAL else [1.0, same_units]
    starts = [Similarity(scale, turn, np.zeros(3)) for scale in scales for turn in rotations]
    begun = [_coarse(first, second, start, FIRST_ROUNDS) for start in starts]
    coarse = [_coarse(first, second, motion, COARSE_ROUNDS) for motion in _best(begun, FIRST_RESIDUAL)]
    fine = [_fine(first, second, motion) for motion in _best(coarse, COARSE_RESIDUAL)]
    refined = [motion for motion in fine if motion is not None]
    return min(refined, key=lambda motion: _clipped(first, second, motion), default=None)


def _best(fits: list[tuple[float, Similarity]], most: float) -> list[Similarity]:
    """Return the transforms of residual at most `most`, and at most `RESIDUAL_RATIO` times the least."""
    least = min((residual for residual, _ in fits), default=np.inf)
    return [motion for residual, motion in fits if residual <= min(most, RESIDUAL_RATIO * least)]


def _coarse(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity, rounds: int
) -> tuple[float, Similarity]:
    """Return the trimmed residual and the transform after coarse iterations at a given scale."""
    few = first.points[:: len(first.points) // FEW]
    kept = round(SHARE * len(few))
    before = np.empty(0, dtype=np.intp)
    for _ in range(rounds):
        gaps, near = second.tree.query(motion.apply(few))
        order = np.argsort(gaps)[:kept]
        if np.array_equal(near[order], before):
            break
        before = near[order]
        turned = best_similarity(motion.scale * few[order], second.points[before], sign=1, scaled=False)
        motion = Similarity(motion.scale, turned.rotation, turned.shift)
    gaps = np.sort(second.tree.query(motion.apply(few))[0])[:kept]
    return float(np.sqrt((gaps**2).mean())), motion


def _fine(first: SurfaceSamples, second: SurfaceSamples, motion: Similarity) -> Similarity | None:
    """Return the transform refined in both directions; None if too little of one surface is on the other."""
    for _ in range(ROUNDS):
        ours, theirs = _closest(first, second, motion)
        sources, targets = [], []
        for source, target in (ours, theirs):
            gaps = np.linalg.norm(motion.apply(source) - target, axis=1)
            order = np.argsort(gaps)
            # The share grows to all points that lie on the other surface.
            kept = order[: max(round(SHARE * len(gaps)), int((gaps <= NEAR).sum()))]
            sources.append(source[kept])
            targets.append(target[kept])
        motion = best_similarity(np.concatenate(sources), np.concatenate(targets), sign=1, scaled=True)
    for source, target in _closest(first, second, motion):
        gaps = np.sort(np.linalg.norm(motion.apply(source) - target, axis=1))[: round(SHARE * len(source))]
        if np.sqrt((gaps**2).mean()) > RESIDUAL:
            return None
    return motion


def _closest(
    first: SurfaceSamples, second: SurfaceSamples, motion: Similarity
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return paired points of both surfaces: from the first to the second, and back."""
    ours, theirs = first.representatives, second.representatives
    ahead = ours, closest_points(second, motion.apply(ours))
    behind = closest_points(first, motion.invert(theirs)), theirs
    return ahead, behind


def _clipped(first: SurfaceSamples, second: SurfaceSamples, motion: Similarity) -> float:
    """Return the mean distance both ways, of which no point gives more than some times `NEAR`."""
    gaps = [np.linalg.norm(motion.apply(a) - b, axis=1) for a, b in _closest(first, second, motion)]
    return float(np.minimum(np.concatenate(gaps), 5.0 * NEAR).mean())
