"""Whether one surface is a rigid copy of another, of its mirror image, or a copy but for a local difference.

Copies with one tessellation have the same samples in the same order, so their records suffice. Other copies
are registered from several initial alignments, first by rotations, then by reflections, and judged by their
largest local deviation relative to the sampling errors of both meshes.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from core.arrays import Floats
from core.descriptors.pieces import RADII, SIZE, number_of_pieces
from core.embedding import Embedding
from core.mesh.bounding_box import least_box_axes
from core.registration.initial_alignments import initial_alignments
from core.registration.probed_surface import ProbedSurface
from core.registration.similarity import NEAR, RESIDUAL, Similarity, best_similarity
from core.registration.surface_fit import (
    LocalDeviation,
    coarsely_fitted,
    fitted,
    local_deviation,
    slid,
    spread_distances,
)

COPY_SPECTRAL, COPY_RADIUS = 0.1, 0.025
"""Largest spectral distance, and largest difference of the ratios of root mean square radius to root of the
area, of two rigid copies or variants. A plate with one more hole has a spectral distance of 0.088, and a
screw that is 5 mm longer 0.066 and a radius that differs by 0.023."""

EQUAL_RADIUS, EQUAL_VOLUME = 0.002, 0.012
"""Largest differences of those ratios, and of the logarithms of the ratios of volume to area to the power
3/2, of two copies whatever their eigenvalues, which follow the triangles where these are slivers. Exports of
30 solids at chord tolerances of 0.01 to 0.3 mm differ by at most a quarter and a half of them."""

IDENTICAL, EXACT = 3e-5, 1e-5
"""Largest distance of the samples of two copies with the same triangles over the root of the area, as
rounding leaves it; and largest relative difference of their areas, volumes and radii."""

ISOSPECTRAL = 1e-4
"""Largest spectral distance of two copies with the same triangles."""

TRIES = 3
"""Largest number of fitted alignments of one sign: a nearly symmetric part has several."""

LOCAL, FITTED, COPIED = 0.5, 0.6, 0.01
"""Largest share of the area that deviates at the local difference of a variant; and largest shares of the
probes that deviate after a coarse fit that is refined to a variant, and after one that is refined to a copy.
The best coarse fits of 143 copies, of machine parts and scans, left no probe that deviates."""

CLOSE = 0.9
"""Share of the area of either surface that is within `NEAR` of the other, above which more may deviate after
a coarse fit: both sides of a plate of another thickness do. So may most probes, which are dense at edges, if
half of the area lies on the other surface."""


EQUAL_SIDES = 0.01
"""Two sides of a variant's box differ by at most this share: a local difference changes one, if any."""

DRAWN = 0.1
"""Largest difference, of those shares, of the coarse fits of a variant that are refined: a plate that is 1 mm
longer leaves 0.164 where its holes coincide, and 0.162 where it is turned."""


@dataclass(frozen=True)
class Difference:
    """Where two surfaces differ that are equal elsewhere, and how much.

    Attributes
    ----------
    point : tuple of 3 float
        Where they are farthest apart, in the units of the first file.
    low, high : tuple of 3 float
        The box that holds all differences.
    distance : float
        The largest distance of the surfaces, in the units of the first file.
    sides : two of tuple of 3 float
        Length, width and height of the least box around the first, the largest first, and the extents of the
        second along them; in the units of the first file, both in one size.
    volume : float or None
        Volume of the second over that of the first, both in one size, if both meshes are closed.
    area : float
        Area of the second over that of the first, both in one size.
    through_holes : tuple of 2 int, or None
        Their numbers of through holes, if both meshes are closed.
    """

    point: tuple[float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    distance: float
    sides: tuple[tuple[float, float, float], tuple[float, float, float]]
    volume: float | None
    area: float
    through_holes: tuple[int, int] | None


@dataclass(frozen=True)
class RigidCopy:
    """A surface that is a rigid copy of another one or of its mirror image, or a variant of it.

    Attributes
    ----------
    scale : float
        Length in the copy over length in the other surface, > 0.
    mirrored : bool
        Whether it is a copy of the mirror image and not of the surface: a symmetric surface is both.
    residual : float
        Root mean square distance of the surfaces, both ways, over the root of the area; of a variant without
        what deviates.
    difference : Difference or None
        The local difference of a variant; None for a copy.
    placing : Similarity
        Maps the copy onto the other surface, in the units of their files.
    """

    scale: float
    mirrored: bool
    residual: float = 0.0
    difference: Difference | None = None
    placing: Similarity = field(kw_only=True, compare=False)


class Proportions(NamedTuple):
    """Sizes of a surface at unit area.

    Attributes
    ----------
    radius : float
        Root mean square distance from the centroid.
    volume : float or None
        The enclosed volume, > 0; None for an open or flat surface.
    """

    radius: float
    volume: float | None


def proportions(*, area: float, volume: float, scale: float, boundary_edges: int) -> Proportions:
    """Return the proportions of a surface with these facts (`core.embedding.Facts`)."""
    is_solid = not boundary_edges and volume > 0.0
    return Proportions(scale / area**0.5, volume / area**1.5 if is_solid else None)


def may_be_copy(spectral: float, first: Proportions, second: Proportions) -> bool:
    """Return whether eigenvalues or proportions allow that two surfaces are rigid copies or variants.

    `spectral` is the distance of their log eigenvalues, >= 0.
    """
    gap = abs(first.radius - second.radius)
    if spectral <= COPY_SPECTRAL:
        return gap <= COPY_RADIUS
    if first.volume is None or second.volume is None:
        return gap <= EQUAL_RADIUS
    return gap <= EQUAL_RADIUS and abs(math.log(first.volume / second.volume)) <= EQUAL_VOLUME


def have_equal_axes(first: Embedding, second: Embedding) -> bool:
    """Return whether the principal radii allow that two surfaces are rigid copies or variants.

    Each radius, over the root of the area, differs by at most `COPY_RADIUS`: surfaces of one total radius may
    be long or flat. Nothing is known of surfaces of several pieces.
    """
    if number_of_pieces(first.pieces) != 1 or number_of_pieces(second.pieces) != 1:
        return True
    ours, theirs = (one.pieces[0, RADII] / one.pieces[0, SIZE] for one in (first, second))
    return bool(np.abs(ours - theirs).max() <= COPY_RADIUS)


def copy_by_samples(first: Embedding, second: Embedding, spectral: float) -> RigidCopy | None:
    """Return the second surface as a copy of the first, by two embeddings; None if they do not decide it.

    The samples must coincide, in their order, after a rotation and a scaling: surfaces with other
    tessellations have other samples. Samples that coincide after a reflection tell nothing, as the surface
    may be symmetric. A difference between the samples shows in the area, the volume, the radius or the
    eigenvalues, whose logarithms have the distance `spectral`.
    """
    ours, theirs = first.facts, second.facts
    if (ours.vertices, ours.faces) != (theirs.vertices, theirs.faces) or spectral > ISOSPECTRAL:
        return None
    if len(first.positions) != len(second.positions):
        return None
    source, target = (one.positions.astype(np.float64) for one in (first, second))
    motion = best_similarity(source, target, sign=1, scaled=True)
    gaps = np.linalg.norm(target - motion.apply(source), axis=1)
    scale = motion.scale
    expected = np.array([ours.area * scale**2, ours.volume * scale**3, ours.scale * scale])
    same = np.allclose(expected, [theirs.area, theirs.volume, theirs.scale], rtol=EXACT, atol=0.0)
    near = gaps.max() <= IDENTICAL * np.sqrt(theirs.area)
    return RigidCopy(scale, mirrored=False, placing=motion.inverse) if same and near else None


def copy_by_surfaces(
    first: ProbedSurface, second: ProbedSurface, pairs: tuple[Floats, Floats], *, variants: bool = True
) -> RigidCopy | None:
    """Register two surfaces; return the second as a copy or variant of the first, None if it is neither.

    A variant is a rotated copy, of any size, but for a local difference; variants of the mirror image are not
    sought. Without variants, most pairs that are no copies take half of the time. `pairs` are corresponding
    points of both surfaces, shapes (m, 3), in the files' units, for one of the initial alignments.
    """
    if _are_one_polyhedron(first, second):
        # The triangles of a symmetric part need not be symmetric: smooth surfaces tell reflections.
        copy = _registered(first.faceted, second.faceted, pairs, variants=False)
        if copy is not None and not copy.mirrored:
            return copy
    return _registered(first, second, pairs, variants=variants)


def _are_one_polyhedron(first: ProbedSurface, second: ProbedSurface) -> bool:
    """Return whether volumes and moments allow that the triangles of both meshes cover the same facets."""
    ours, theirs = (np.append(one.curved.moments, one.curved.volume) for one in (first, second))
    return bool(np.abs(ours - theirs).max() <= EXACT)


def _registered(
    first: ProbedSurface, second: ProbedSurface, pairs: tuple[Floats, Floats], *, variants: bool
) -> RigidCopy | None:
    variant, least = None, np.inf
    for sign, most, seeks_variants in ((1, FITTED if variants else COPIED, variants), (-1, COPIED, False)):
        fits = _coarse_fits(first, second, pairs, sign)
        # A reflection is refined only if it leaves no more deviating points than the rotation, or none.
        if not fits:
            continue
        if fits[0].deviating > min(most, least) and not (
            seeks_variants and _are_close(first, second, fits[0].motion)
        ):
            continue
        least = fits[0].deviating
        # A local difference draws a coarse fit: only fine ones tell which alignment leaves the least of it.
        near = [fit for fit in fits if fit.deviating <= least + DRAWN] if least > COPIED else fits[:1]
        motions = [fitted(first, second, fit.motion) for fit in near]
        judged = _judged(first, second, motions)
        nearest = min(judged, key=lambda fit: fit[0].rms)
        if seeks_variants and not _is_local(nearest[0]) and _are_close(first, second, nearest[1]):
            starts = slid(first, second, nearest[1])
            judged += _judged(first, second, [fitted(first, second, start) for start in starts])
        deviation, motion = min(
            judged, key=lambda fit: (not fit[0].within, not _is_local(fit[0]), fit[0].rms)
        )
        scale = motion.scale * second.samples.unit / first.samples.unit
        if deviation.within:
            mirrored = sign < 0 and not (_is_achiral(first) or _is_achiral(second))
            placing = _placing(first, second, motion)
            return RigidCopy(scale, mirrored=mirrored, residual=deviation.rms, placing=placing)
        if seeks_variants and _is_local(deviation):
            difference = _difference(first, second, motion, deviation)
            if not _has_equal_sides(difference):
                continue
            variant = RigidCopy(
                scale,
                mirrored=False,
                residual=deviation.residual,
                difference=difference,
                placing=_placing(first, second, motion),
            )
    return variant


def _judged(
    first: ProbedSurface, second: ProbedSurface, motions: Iterable[Similarity]
) -> list[tuple[LocalDeviation, Similarity]]:
    """Return the deviation under each of some transforms."""
    return [(local_deviation(first, second, motion), motion) for motion in motions]


def _are_close(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> bool:
    """Return whether nearly all of either surface is near the other, or half of it lies on the other."""
    return all(
        (gaps <= NEAR).mean() >= CLOSE or (gaps <= RESIDUAL).mean() >= 1.0 - LOCAL
        for gaps in spread_distances(first, second, motion)
    )


def _is_local(deviation: LocalDeviation) -> bool:
    """Return whether two surfaces are equal but for a part of them."""
    return deviation.share <= LOCAL and deviation.residual <= RESIDUAL


def _has_equal_sides(difference: Difference) -> bool:
    """Return whether two sides of the least box are equal; a flat part has a side of 0, up to rounding."""
    first, second = map(np.array, difference.sides)
    return bool((np.abs(second - first) <= EQUAL_SIDES * first + EXACT * first.max()).sum() >= 2)


def _placing(first: ProbedSurface, second: ProbedSurface, motion: Similarity) -> Similarity:
    """Return the inverse of a transform at unit area, in the units of the files."""
    back, ours, theirs = motion.inverse, first.samples, second.samples
    scale = back.scale * ours.unit / theirs.unit
    shift = ours.unit * back.shift + ours.centre - scale * back.rotation @ theirs.centre
    return Similarity(scale, back.rotation, shift)


def _is_achiral(surface: ProbedSurface) -> bool:
    """Return whether a surface is a copy of its own mirror image."""
    points = surface.samples.representatives * surface.samples.unit + surface.samples.centre
    fits = _coarse_fits(surface, surface, (points, points), -1)
    if not fits or fits[0].deviating > COPIED:
        return False
    return local_deviation(surface, surface, fitted(surface, surface, fits[0].motion)).within


class _CoarseFit(NamedTuple):
    """A transform after a coarse fit, and the share of points that deviate."""

    deviating: float
    motion: Similarity


def _coarse_fits(
    first: ProbedSurface, second: ProbedSurface, pairs: tuple[Floats, Floats], sign: int
) -> list[_CoarseFit]:
    """Return the coarse fits of one sign, the least share of deviating points first."""
    tried: list[Similarity] = []
    fits: list[_CoarseFit] = []
    for start in initial_alignments(first, second, pairs, sign):
        if len(tried) == TRIES or (fits and fits[-1].deviating == 0.0):
            break
        if any(_alike(start, other) for other in tried):
            continue
        tried.append(start)
        motion, deviating = coarsely_fitted(first, second, start)
        fits.append(_CoarseFit(deviating, motion))
    return sorted(fits, key=lambda fit: fit.deviating)


def _alike(one: Similarity, other: Similarity) -> bool:
    """Return whether two alignments lead to one fit: their rotations differ by less than three degrees."""
    return bool(np.trace(one.rotation.T @ other.rotation) > 1.0 + 2.0 * np.cos(np.radians(3.0)))


def _difference(
    first: ProbedSurface, second: ProbedSurface, motion: Similarity, deviation: LocalDeviation
) -> Difference:
    unit, centre = first.samples.unit, first.samples.centre
    points = deviation.points * unit + centre
    ours, theirs = (one.curved.corners.reshape(-1, 3) for one in (first, second))
    axes = least_box_axes(ours / np.abs(ours).max())
    extents = np.array([np.ptp(corners @ axes.T, axis=0) for corners in (ours, motion.invert(theirs))])
    sides = unit * extents[:, np.argsort(-extents[0])]
    holes, volume = None, None
    if first.curved.handles is not None and second.curved.handles is not None:
        holes = first.curved.handles, second.curved.handles
        if first.curved.volume > 0.0 and second.curved.volume > 0.0:
            volume = second.curved.volume / (first.curved.volume * motion.scale**3)
    return Difference(
        point=_floats(points[0]),
        low=_floats(points.min(axis=0)),
        high=_floats(points.max(axis=0)),
        distance=deviation.largest * unit,
        sides=(_floats(sides[0]), _floats(sides[1])),
        volume=volume,
        area=1.0 / motion.scale**2,
        through_holes=holes,
    )


def _floats(point: Floats) -> tuple[float, float, float]:
    x, y, z = point.tolist()
    return x, y, z
