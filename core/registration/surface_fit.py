"""The similarity transform between two smooth surfaces, from a near one: robust point-to-plane iterations.

Y. Chen and G. Medioni, "Object modelling by registration of multiple range images", Image and Vision
Computing 10(3), 1992, with a scale and in both directions. Each pair counts by its variance, which its chord
errors give, and far pairs hardly count (the weights of S. Geman and D. McClure, as in Q.-Y. Zhou, J. Park and
V. Koltun, "Fast global registration", ECCV 2016), so that a local difference does not pull.
"""

import numpy as np

from core.arrays import Floats, Ints
from core.registration.probed_surface import ProbedSurface
from core.registration.similarity import Similarity

ROUNDS = 8
"""Most iterations."""

STILL = 1e-6
"""Iterations end when no point moves farther, in units of the root of the area."""

WIDTH, SHRINK = 0.02, 0.25
"""Distance at which a pair has a quarter of its weight in the first iteration, and its factor from one to the
next, down to the precision of the pair."""

PRECISION, CURVED = 1e-4, 0.25
"""Standard deviation of a distance between two copies: over the root of the area, and in addition over the
chord error. The points of `CurvedSurface.at` are nearer to the smooth surface than the triangles."""

COARSE = 3
"""Stride through the points in a coarse fit."""

FARTHEST = 1.5
"""Largest distance that sampling explains, over the sum of the chord errors of both meshes."""

_Faces = tuple[Ints | None, Ints | None]

DAMPING = 1e-9
"""Relative damping, for surfaces that a motion leaves as they are."""


def coarsely_fitted(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Similarity, float]:
    """The transform fitted to some of the points, and the share of these that deviate."""
    faces: _Faces = (None, None)
    width = WIDTH
    while width > PRECISION:
        motion, faces, _, _ = _stepped(first, second, motion, COARSE, width, faces)
        width *= SHRINK
    _, _, _, deviating = _stepped(first, second, motion, COARSE, width, faces)
    return motion, deviating


def fitted(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> Similarity:
    """The similarity transform of the first surface onto the second, both at unit area, from a coarse fit."""
    faces: _Faces = (None, None)
    for _ in range(ROUNDS):
        motion, faces, moved, _ = _stepped(first, second, motion, 1, PRECISION, faces)
        if moved <= STILL:
            break
    return motion


def _stepped(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity, stride: int, width: float, faces: _Faces
) -> tuple[Similarity, _Faces, float, float]:
    """One Gauss-Newton step.

    Parameters
    ----------
    first, second : ProbedSurface
    motion : Similarity
    stride : int
        Stride through the points.
    width : float
        Distance at which a pair has a quarter of its weight.
    faces : two of int64 or None
        Closest faces of the step before.

    Returns
    -------
    Similarity
        The next transform.
    two of int64
        The closest faces.
    float
        The largest change of a parameter.
    float
        Share of the points that deviated before the step.
    """
    ours, theirs = first.fit[::stride], second.fit[::stride]
    moved, targets = motion.apply(first.points[ours]), second.points[theirs]
    there, near = second.curved.closest(moved, faces[0])
    here, behind = first.curved.closest(motion.invert(targets), faces[1])
    ahead, ahead_normals, ahead_errors = second.curved.at(there, near)
    back, back_normals, back_errors = first.curved.at(here, behind)
    points = np.concatenate([moved, motion.apply(back)])
    normals = np.concatenate([ahead_normals, back_normals @ motion.rotation.T])
    gaps = np.concatenate([ahead, targets]) - points
    squares = (gaps**2).sum(axis=1)
    spans = np.concatenate([first.errors[ours] + ahead_errors, second.errors[theirs] + back_errors])
    deviations = PRECISION + CURVED * spans
    widths = np.maximum(width, deviations)
    weights = (widths / deviations * widths / (widths**2 + squares)) ** 2
    rows = np.column_stack([np.cross(points, normals), (normals * points).sum(axis=1), normals])
    matrix = rows.T @ (rows * weights[:, None])
    matrix[np.diag_indices(7)] += DAMPING * np.trace(matrix)
    step = np.linalg.solve(matrix, rows.T @ (weights * (normals * gaps).sum(axis=1)))
    turn, factor = _rotation(step[:3]), float(np.exp(step[3]))
    found = Similarity(motion.scale * factor, turn @ motion.rotation, factor * turn @ motion.shift + step[4:])
    deviating = float((squares > (PRECISION + FARTHEST * spans) ** 2).mean())
    return found, (near, behind), float(np.abs(step).max()), deviating


def _rotation(vector: Floats) -> Floats:
    """The rotation about a vector by its length in radians (Rodrigues), shape (3, 3)."""
    angle = float(np.linalg.norm(vector))
    cross = np.cross(vector, np.eye(3)).T
    turn = np.eye(3) + np.sinc(angle / np.pi) * cross
    return np.asarray(turn + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross @ cross)
