"""The similarity transform between two smooth surfaces, from a near one: robust point-to-plane iterations.

Y. Chen and G. Medioni, "Object modelling by registration of multiple range images", Image and Vision
Computing 10(3), 1992, with a scale and in both directions. Each pair counts by its variance, which its chord
errors give, or the distance of two planes, and far pairs hardly count (the weights of S. Geman and D.
McClure, as in Q.-Y. Zhou, J. Park and V. Koltun, "Fast global registration", ECCV 2016), so that a local
difference does not pull.

Two tessellations of one surface differ by their chord errors. A deviation beyond these errors, after the fit,
is a difference of the surfaces: of a few probes, of vertices side by side, or, smaller, of a whole smooth
region such as the wall of a hole.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.edges import component_labels
from core.registration.curved_surface import CREASE, ON_EDGE
from core.registration.probed_surface import SPREAD, VERTICES, ProbedSurface
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

EXACT_PLANES = 1e-5
"""Standard deviation of a distance between two planes that only sharp edges bound: the distance itself, but
at least this and at most `PRECISION`. Such planes tell the scale where vertices lie beside a curved surface.
"""

COARSE = 3
"""Stride through the points in a coarse fit."""

FARTHEST = 1.5
"""Largest distance that sampling explains, over the sum of the chord errors of both meshes."""

_Faces = tuple[Ints | None, Ints | None]

DAMPING = 1e-9
"""Relative damping, for surfaces that a motion leaves as they are."""

OUTLIERS = 6
"""Rank of the deviation that counts as the largest, and least number of vertices side by side that deviate
where few probes lie: a few may lie on flaws of a mesh. Each smooth region has more, whose mean deviation
counts."""

REGION_PROBES = 6
"""Least number of probes of a region whose mean deviation counts."""

REGION, ANY_REGION, ONE_SIDED = 1.15, 2.0, 0.6
"""Root mean square deviation of a region over its expected standard deviation, above which sampling does not
explain it: of a region of which the mean deviation is `ONE_SIDED` of it, and of any. Threads at another
tolerance have 1.8, and 0.4 of it in the mean; the wall of a hole that is a little larger 1.26, and 0.8 of it.
"""


def coarsely_fitted(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Similarity, float]:
    """Return the transform fitted to some of the points, and the share of these that deviate."""
    faces: _Faces = (None, None)
    width = WIDTH
    while width > PRECISION:
        motion, faces, _, _ = _stepped(first, second, motion, COARSE, width, faces)
        width *= SHRINK
    _, _, _, deviating = _stepped(first, second, motion, COARSE, width, faces)
    return motion, deviating


def fitted(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> Similarity:
    """Return the transform of the first surface onto the second, at unit area, from a coarse fit."""
    faces: _Faces = (None, None)
    for _ in range(ROUNDS):
        motion, faces, moved, _ = _stepped(first, second, motion, 1, PRECISION, faces)
        if moved <= STILL:
            break
    return motion


def slid(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> list[Similarity]:
    """Return transforms that slide the first surface either way until sides that are apart coincide.

    One side of a thicker plate then coincides; without the slide both sides are half a step apart.
    """
    points, normals = first.points[-SPREAD:], first.normals[-SPREAD:] @ motion.rotation.T
    moved = motion.apply(points)
    shares, faces = second.curved.closest(moved)
    targets, _, errors = second.curved.at(shares, faces)
    gaps = np.einsum("nx,nx->n", targets - moved, normals)
    far = np.abs(gaps) > PRECISION + FARTHEST * (first.errors[-SPREAD:] + errors)
    if not far.any():
        return []
    gaps, normals = gaps[far], normals[far]
    axis = np.linalg.eigh((normals * np.abs(gaps)[:, None]).T @ normals)[1][:, -1]
    along = np.abs(normals @ axis) > CREASE
    if not along.any():
        return []
    step = float(np.median(np.abs(gaps[along]))) * axis
    return [Similarity(motion.scale, motion.rotation, motion.shift + way * step) for way in (1.0, -1.0)]


def _stepped(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity, stride: int, width: float, faces: _Faces
) -> tuple[Similarity, _Faces, float, float]:
    """Take one Gauss-Newton step, from the points of `stride` and the closest faces of the step before.

    A pair at the distance `width` has a quarter of its weight, if not both are planes. Return the next
    transform, the closest faces, the largest change of a parameter, and the share of the points that deviated
    before the step.
    """
    ours, theirs = first.fit[::stride], second.fit[::stride]
    # Pairs of points and closest points, both ways, in the frame of the second surface.
    moved, targets = motion.apply(first.points[ours]), second.points[theirs]
    second_shares, second_faces = second.curved.closest(moved, faces[0])
    first_shares, first_faces = first.curved.closest(motion.invert(targets), faces[1])
    ahead, ahead_normals, ahead_errors = second.curved.at(second_shares, second_faces)
    back, back_normals, back_errors = first.curved.at(first_shares, first_faces)
    points = np.concatenate([moved, motion.apply(back)])
    normals = np.concatenate([ahead_normals, back_normals @ motion.rotation.T])
    gaps = np.concatenate([ahead, targets]) - points
    # Robust weights: near pairs count by their variance, far ones hardly. Vertices have no chord error.
    squares = (gaps**2).sum(axis=1)
    spans = np.concatenate([first.errors[ours] + ahead_errors, second.errors[theirs] + back_errors])
    sag = np.concatenate(
        [
            first.curved.sagged(first.shares[ours], first.faces[ours])
            + second.curved.sagged(second_shares, second_faces),
            second.curved.sagged(second.shares[theirs], second.faces[theirs])
            + first.curved.sagged(first_shares, first_faces),
        ]
    )
    planes = np.concatenate(
        [
            first.curved.planar[first.faces[ours]] & second.curved.planar[second_faces],
            second.curved.planar[second.faces[theirs]] & first.curved.planar[first_faces],
        ]
    )
    deviations = np.where(
        planes, np.clip(np.sqrt(squares), EXACT_PLANES, PRECISION), PRECISION + CURVED * sag
    )
    widths = np.maximum(width, deviations)
    weights = (widths / deviations * widths / (widths**2 + squares)) ** 2
    # The linear system of rotation, log scale and shift.
    rows = np.column_stack([np.cross(points, normals), (normals * points).sum(axis=1), normals])
    matrix = rows.T @ (rows * weights[:, None])
    matrix[np.diag_indices(7)] += DAMPING * np.trace(matrix)
    step = np.linalg.solve(matrix, rows.T @ (weights * (normals * gaps).sum(axis=1)))
    turn, factor = _rotation(step[:3]), float(np.exp(step[3]))
    next_motion = Similarity(
        motion.scale * factor, turn @ motion.rotation, factor * turn @ motion.shift + step[4:]
    )
    deviating = float((squares > (PRECISION + FARTHEST * spans) ** 2).mean())
    return next_motion, (second_faces, first_faces), float(np.abs(step).max()), deviating


def _rotation(vector: Floats) -> Floats:
    """Return the rotation about a vector by its length in radians (Rodrigues), shape (3, 3)."""
    angle = float(np.linalg.norm(vector))
    cross = np.cross(vector, np.eye(3)).T
    turn = np.eye(3) + np.sinc(angle / np.pi) * cross
    return np.asarray(turn + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross @ cross)


@dataclass(frozen=True, eq=False)
class LocalDeviation:
    """The deviation of two surfaces after registration.

    Attributes
    ----------
    within : bool
        Whether sampling explains the deviation, so that the surfaces are equal.
    largest : float
        The largest distance between the surfaces, in both directions, in units of the root of the area.
    share : float
        Share of the area that deviates, on both surfaces together.
    residual : float
        Root mean square distance of the probes that do not deviate.
    rms : float
        Root mean square distance of the probes that are spread by area.
    points : float64, shape (k, 3)
        The probes that deviate, or vertices side by side if few probes do, on the first surface at unit area,
        the farthest first.
    """

    within: bool
    largest: float
    share: float
    residual: float
    rms: float
    points: Floats


def local_deviation(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> LocalDeviation:
    """Return the deviation under a transform of the first surface onto the second, both at unit area."""
    back = motion.inverse
    ahead, ahead_spans, ahead_regions = _one_way(first, second, motion)
    behind, behind_spans, behind_regions = _one_way(second, first, back)
    gaps, spans = np.concatenate([ahead, behind]), np.concatenate([ahead_spans, behind_spans])
    regions = np.concatenate([ahead_regions, behind_regions])
    points = np.concatenate([first.points, back.apply(second.points)])
    excess = gaps / (PRECISION + FARTHEST * spans)
    far = regions | (excess > 1.0)
    order = np.flatnonzero(far)[np.argsort(-gaps[far], kind="stable")]
    worst = np.partition(excess, -OUTLIERS)[-OUTLIERS]
    within, largest, points = bool(worst <= 1.0 and not regions.any()), gaps.max(), points[order]
    if len(order):
        largest = gaps[order[0]]
    if within:
        patches = _patch(first, second, motion), _patch(second, first, back)
        found = np.concatenate([patches[0][0], patches[1][0]])
        if len(found):
            order = np.argsort(-found, kind="stable")
            within, largest = False, found[order[0]]
            points = np.concatenate([patches[0][1], back.apply(patches[1][1])])[order]
    return LocalDeviation(
        within=within,
        largest=float(largest),
        share=float(np.concatenate([far[: len(ahead)][-SPREAD:], far[-SPREAD:]]).mean()),
        residual=float(np.sqrt((gaps[~far] ** 2).mean())) if not far.all() else float(gaps.max()),
        rms=float(np.sqrt(0.5 * (ahead[-SPREAD:] ** 2).mean() + 0.5 * (behind[-SPREAD:] ** 2).mean())),
        points=points,
    )


def _patch(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> tuple[Floats, Floats]:
    """Return distances of the vertices of the first surface that deviate side by side, and their points."""
    if len(first.corners) <= VERTICES:
        # All of them are probes.
        return np.empty(0), np.empty((0, 3))
    curved = first.curved
    shares, faces = np.eye(3)[first.corners % 3], first.corners // 3
    points, normals, _ = curved.at(shares, faces)
    errors = curved.errors_of(shares, faces)
    # Most vertices are within their own error of some triangle, which ends their search.
    moved, near = motion.apply(points), PRECISION + FARTHEST * errors
    shares, other = second.curved.tree.closest(moved, near=near)
    closest = np.einsum("nc,ncx->nx", shares, second.curved.corners[other])
    rows = np.flatnonzero(np.linalg.norm(closest - moved, axis=1) > near)
    if len(rows) < OUTLIERS:
        return np.empty(0), np.empty((0, 3))
    gaps, _, spans = distances_to(second, points[rows], normals[rows], errors[rows], motion)
    over = gaps > PRECISION + FARTHEST * spans
    rows, gaps = rows[over], gaps[over]
    if len(rows) < OUTLIERS:
        return np.empty(0), np.empty((0, 3))
    far = np.zeros(len(points), dtype=bool)
    far[rows] = True
    faces = curved.corner_vertices.reshape(-1, 3)
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, patches = component_labels(len(points), sides[far[sides].all(axis=1)])
    chosen = np.bincount(patches[rows])[patches[rows]] >= OUTLIERS
    return gaps[chosen], points[rows[chosen]]


def distances_to(
    second: ProbedSurface, points: Floats, normals: Floats, errors: Floats, motion: Similarity
) -> tuple[Floats, Floats, Floats]:
    """Return the distances of points of the first surface from the second, and the chord errors of both.

    `points` and `normals`, shape (n, 3), have the chord errors `errors`, shape (n,); all is at unit area. The
    second result has the distances that count for a whole region: those along the normal of a point that lies
    beyond a rim of the second surface, as a wall ends where the surface at its rim does. They are negative
    where the second surface lies behind the first.
    """
    moved = motion.apply(points)
    shares, faces = second.curved.closest(moved)
    targets, target_normals, other_errors = second.curved.at(shares, faces)
    gaps = np.linalg.norm(targets - moved, axis=1)
    # The surface beyond the boundary of a gap is unknown.
    least = shares.argmin(axis=1)
    on_edge = shares[np.arange(len(shares)), least] <= ON_EDGE
    sides = 3 * faces + (least + 1) % 3
    gaps[on_edge & second.curved.at_gap[sides]] = 0.0
    # The closest point of a probe beyond a rim lies on the rim, or on another side of it.
    turned = normals @ motion.rotation.T
    beyond = np.einsum("nx,nx->n", turned, target_normals) < CREASE
    along = np.einsum("nx,nx->n", targets - moved, turned)
    off = beyond | (on_edge & second.curved.at_rim[sides])
    places = np.copysign(np.where(off, np.minimum(np.abs(along), gaps), gaps), along)
    return gaps, places, errors + other_errors


def spread_distances(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Floats, Floats]:
    """Return the distances of the points spread over either surface, all in the unit of the second."""
    ahead, back = (
        distances_to(other, one.points[-SPREAD:], one.normals[-SPREAD:], one.errors[-SPREAD:], transform)[0]
        for one, other, transform in ((first, second, motion), (second, first, motion.inverse))
    )
    return ahead, back * motion.scale


def deviating_regions(first: ProbedSurface, places: Floats, spans: Floats) -> NDArray[np.bool_]:
    """Return which smooth regions have a mean deviation that sampling does not explain, shape (r,).

    `places` and `spans` are those of all probes of the first surface (`distances_to`).
    """
    region, total = first.curved.regions[first.faces], int(first.curved.regions.max()) + 1
    count = np.maximum(np.bincount(region, minlength=total), 1)
    deviation = np.sqrt(np.bincount(region, places**2, total) / count)
    expected = PRECISION + CURVED * np.sqrt(np.bincount(region, spans**2, total) / count)
    one_sided = np.abs(np.bincount(region, places, total)) / count >= ONE_SIDED * deviation
    most = np.where(one_sided, REGION, ANY_REGION) * expected
    return np.asarray((count >= REGION_PROBES) & (deviation > most))


def _one_way(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return distances of the probes, chord errors of both meshes, and which probes deviate by region."""
    gaps, places, spans = distances_to(second, first.points, first.normals, first.errors, motion)
    deviating = deviating_regions(first, places, spans)[first.curved.regions[first.faces]]
    return gaps, spans, deviating & (np.abs(places) > PRECISION + CURVED * spans)
