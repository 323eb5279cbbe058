"""Initial alignments of two surfaces, the most promising first.

A correspondence gives one; the principal axes give four. Where two principal moments are nearly equal, as of
a flange, a gear or a square plate, the angle about the third axis comes from the circular correlation of both
surfaces: of their sharp edges, or of all their samples if they have none.
"""

from itertools import product

import numpy as np

from core.arrays import Floats
from core.registration.probed_surface import ProbedSurface
from core.registration.similarity import Similarity, best_similarity

TIED = 0.1
"""Principal moments are tied if they differ by less than this share of the larger one."""

ANGLES, RINGS, LAYERS = 720, 6, 6
"""Cells of the histogram of angles, of distances from the axis, and of heights."""

BLUR = 2.0
"""Standard deviation of the blur of the histogram, in cells of angle."""

PEAKS, APART = 5, 6
"""Angles that are tried, and the least distance of two, in cells."""

FEW, ROUNDS = 130, 5
"""Points of either kind, and most iterations, of a coarse alignment."""

FAR = 0.05
"""Distances count to at most this, in units of the root of the area."""

HOPELESS = 0.02
"""Largest root mean square distance of the sample points of two aligned copies, 0.016 apart themselves."""

FORWARDED, RATIO = 4, 2.0
"""Starts that are iterated, and the largest ratio of the distance of an alignment to that of the nearest."""


def initial_alignments(
    first: ProbedSurface, second: ProbedSurface, pairs: tuple[Floats, Floats], sign: int
) -> list[Similarity]:
    """Return coarse alignments at scale 1, the nearest first; those that are far are left out.

    `pairs` are corresponding points of both surfaces, shapes (m, 3), in the files' units; some may be wrong.
    The sign of the determinant is 1 for rotations, -1 for reflections.
    """
    ends = first.samples.to_unit(pairs[0]), second.samples.to_unit(pairs[1])
    starts = [best_similarity(*ends, sign=sign, scaled=False)]
    axes = first.samples.axes, second.samples.axes
    starts += [
        Similarity(1.0, axes[1].T * signs @ axes[0], np.zeros(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.prod(signs) == sign
    ]
    moments = [
        ((surface.samples.points @ surface.samples.axes.T) ** 2).mean(axis=0) for surface in (first, second)
    ]
    for axis, (first_axis, second_axis) in ((2, (0, 1)), (0, (1, 2))):
        if all(
            abs(values[first_axis] - values[second_axis]) < TIED * values[first_axis] for values in moments
        ):
            starts += _about(first, second, axis, sign)
    nearest = sorted(starts, key=lambda start: _distance(first, second, start))[:FORWARDED]
    iterated = [_iterated(first, second, start, sign) for start in nearest]
    near = [motion for motion in iterated if _spread_distance(first, second, motion) <= HOPELESS]
    gaps = [_distance(first, second, motion) for motion in near]
    return [near[index] for index in np.argsort(gaps, kind="stable") if gaps[index] <= RATIO * min(gaps)]


def _few(points: Floats) -> Floats:
    return points[:: max(1, len(points) // FEW)]


def _closest(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Floats, Floats, Floats]:
    """Return points on the surface and on its sharp edges, and their distances to the second surface."""
    points = _few(first.samples.points)
    gaps, near = second.samples.tree.query(motion.apply(points))
    targets = second.samples.points[near]
    if len(first.rims) and len(second.rims):
        rims = _few(first.rims)
        rim_gaps, rim_near = second.rim_tree.query(motion.apply(rims))
        points, gaps = np.concatenate([points, rims]), np.concatenate([gaps, rim_gaps])
        targets = np.concatenate([targets, second.rims[rim_near]])
    return points, gaps, targets


def _distance(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> float:
    """Return the root mean square distance of sample points and points of sharp edges, cut off at `FAR`."""
    gaps = np.minimum(_closest(first, second, motion)[1], FAR)
    return float(np.sqrt((gaps**2).mean()))


def _spread_distance(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> float:
    """Return the root mean square distance of the sample points alone; edges of an uneven mesh are ragged."""
    gaps = second.samples.tree.query(motion.apply(_few(first.samples.points)))[0]
    return float(np.sqrt((gaps**2).mean()))


def _iterated(first: ProbedSurface, second: ProbedSurface, motion: Similarity, sign: int) -> Similarity:
    """Return the alignment after iterations between closest points, without scaling."""
    before = np.empty(0)
    for _ in range(ROUNDS):
        points, gaps, targets = _closest(first, second, motion)
        if np.array_equal(targets, before):
            break
        before = targets
        near = gaps <= max(FAR, 2.0 * float(np.median(gaps)))
        motion = best_similarity(points[near], targets[near], sign=sign, scaled=False)
    return motion


def _about(first: ProbedSurface, second: ProbedSurface, axis: int, sign: int) -> list[Similarity]:
    """Return alignments that map one principal axis to the other, at the angles of highest correlation."""
    frames = [surface.samples.axes[[(axis + 1) % 3, (axis + 2) % 3, axis]] for surface in (first, second)]
    with_rims = len(first.rims) and len(second.rims)
    points = [
        (surface.rims if with_rims else surface.samples.points) @ frame.T
        for surface, frame in zip((first, second), frames, strict=True)
    ]
    reach = float(np.hypot(points[0][:, 0], points[0][:, 1]).max())
    height = float(np.abs(points[0][:, 2]).max())
    target = _spectrum(points[1], reach, height)
    starts = []
    for signs in product((1.0, -1.0), repeat=2):
        mirror = np.array([1.0, signs[0], signs[1]])
        if signs[0] * signs[1] != sign:
            continue
        correlation = np.fft.irfft(
            (np.conj(_spectrum(points[0] * mirror, reach, height)) * target).sum(axis=0), ANGLES
        )
        for _ in range(PEAKS):
            peak = int(correlation.argmax())
            angle = 2.0 * np.pi * peak / ANGLES
            cos, sin = np.cos(angle), np.sin(angle)
            turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            starts.append(Similarity(1.0, frames[1].T @ turn * mirror @ frames[0], np.zeros(3)))
            correlation[np.arange(peak - APART, peak + APART + 1) % ANGLES] = -np.inf
    return starts


def _spectrum(points: Floats, reach: float, height: float) -> Floats:
    """Return the Fourier transform over the angle of a blurred histogram of cylindrical coordinates."""
    angles = (np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi) % 1.0 * ANGLES).astype(int) % ANGLES
    radii = np.hypot(points[:, 0], points[:, 1])
    rings = np.clip(radii / reach * RINGS, 0, RINGS - 1).astype(int)
    layers = np.clip((points[:, 2] / height + 1.0) / 2.0 * LAYERS, 0, LAYERS - 1).astype(int)
    cells = (rings * LAYERS + layers) * ANGLES + angles
    counts = np.bincount(cells, radii, RINGS * LAYERS * ANGLES).reshape(-1, ANGLES)
    frequencies = np.arange(ANGLES // 2 + 1)
    blur = np.exp(-0.5 * (2.0 * np.pi * BLUR / ANGLES * frequencies) ** 2)
    spectrum = np.fft.rfft(counts, axis=1) * blur
    spectrum[:, 0] = 0.0
    return np.asarray(spectrum)
