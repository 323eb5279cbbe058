"""Several maps between two shapes, and among them those that preserve orientation.

Eigenfunctions do not tell a surface from its mirror image, so the best map of a symmetric shape may exchange
left and right, or front and back. The searches from all signs find the other maps that fit about as well, and
the signed areas of `core.spectral.orientation` tell which of them preserve orientation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Int8s, Int32s, Ints
from core.matching.kernels.match_record import MatchRecord
from core.matching.kernels.pair_matching import refine_maps
from core.matching.kernels.procrustes import EXACT, ROUGH
from core.matching.kernels.spline_search import SearchRounds, search_maps
from core.spectral.orientation import orientation_agreement

FITS_AS_WELL = 0.02
"""A map fits about as well as the best one if its correlation is less by at most this: between poses of one
body, maps that exchange left and right differ from the others by up to 0.01."""

COMPOSED_FITS = 0.01
"""The same for a map that is composed with a symmetry: the symmetries of a chiral shape are approximate."""

AGREEMENT_WEIGHT = 0.02
"""How much the agreement of signed areas counts beside the correlation, where maps are ordered."""

ALIKE = 0.8
"""Two maps are one if they pair at least this share of the samples alike."""

SYMMETRIES = 4
"""Largest number of maps of each shape to itself, and of maps between both, that are composed."""

_Maps = tuple[Float32s, Float32s, Int32s]
"""Rotations (c, b k, b k), scores (c,) and partners (c, s) of the first samples, of c maps."""


@dataclass(frozen=True, eq=False)
class CandidateMaps:
    """Different maps from a shape of m samples to one of n samples that fit about equally well, best first.

    x.points @ rotation lies on y.points. `forward` and `backward`, shapes (m,) and (n,), are the partners of
    the samples of both. Maps that reverse orientation are `mirrored`. `image` tells whether no other map fits
    about as well: one shape is like the mirror image of the other. It is None if maps of either kind fit.
    """

    rotations: list[Float32s]
    forward: list[Int32s]
    backward: list[Int32s]
    mirrored: list[bool]
    image: bool | None


def candidate_maps(
    x: MatchRecord,
    y: MatchRecord,
    orientations: tuple[Int8s, Int8s],
    domain: int,
    rounds: SearchRounds,
    most: int,
) -> CandidateMaps:
    """Return at most `most` maps that preserve orientation and fit about as well as any.

    If `most` is more than 1, half as many that only symmetries of the second shape show follow, and half as
    many that reverse orientation; where no map preserves it, at most `most` are returned.
    The orientations of the embeddings, shapes (m, e) and (n, e), belong to the coordinates of one domain.
    """
    maps = _maps(x, y, rounds)
    searched = len(maps[1])
    agreements = _agreements(x, maps, orientations, domain)
    fitting, preserving = _fitting(maps, agreements)
    if most > 1 or not preserving.any():
        before, after = (_composed(x, y, rounds, maps, of_second=each) for each in (False, True))
        maps = _joined(_joined(maps, before), after)
        searched += len(before[1])
        agreements = _agreements(x, maps, orientations, domain)
        fitting, preserving = _fitting(maps, agreements)
    rotations, scores, partners = maps
    order = np.argsort(-(scores + AGREEMENT_WEIGHT * np.abs(agreements)), kind="stable")
    first = order[order < searched]
    kept = _different(partners, first[preserving[first]], most)
    kept = _different(partners, np.append(kept, order[preserving[order]]).astype(np.int64), most + most // 2)
    reversing = first[(fitting & ~preserving)[first]]
    others = _different(partners, reversing, most // 2 if kept else most)
    # The only maps that fit may be reversing ones that symmetries of the second shape show.
    chosen = kept + others or _different(partners, order[fitting[order]], most)
    mirrored = [not preserving[which] for which in chosen]
    either = preserving.any() and (fitting & ~preserving).any()
    image = None if either else mirrored[0]
    candidates = CandidateMaps([rotations[which] for which in chosen], [], [], mirrored, image)
    count = max(1, rounds.final_rounds + rounds.slides)
    for rotation in candidates.rotations:
        _, forward, backward = _refined(x, y, None, EXACT, count, rotation)
        candidates.forward.append(forward)
        candidates.backward.append(backward)
    return candidates


def _refined(
    x: MatchRecord, y: MatchRecord, samples: int | None, steps: Float32s, count: int, rotation: Float32s
) -> tuple[float, Int32s, Int32s]:
    """Refine a map in place, on the first samples or on all, and return its correlation and pairs."""
    samples_of_x, samples_of_y = (each.points[: len(each.offsets) - 1][:samples] for each in (x, y))
    forward, backward = (np.empty(len(points), dtype=np.int32) for points in (samples_of_x, samples_of_y))
    scores = np.zeros(1)
    for _ in range(count):
        refine_maps(
            samples_of_x, samples_of_y, len(x.radius), steps, rotation[None], scores, forward, backward
        )
    return float(scores[0]), forward, backward


def _maps(x: MatchRecord, y: MatchRecord, rounds: SearchRounds) -> _Maps:
    """Return the map of each sign start of each search, refined on the first samples.

    `search_maps` keeps the best start alone. A symmetric shape has several maps that fit equally well, which
    the searches from other signs find.
    """
    one_start = rounds._replace(starts=1, sides=1)
    columns, domains = x.points.shape[1], len(x.radius)
    rotations = np.zeros((domains, columns, columns), dtype=np.float32)
    correlations = np.empty(domains)
    maps, scores, partners = [], [], []
    for start in range(rounds.starts):
        signs = np.ones((1, x.searched.shape[1], 1), dtype=np.float32)
        for c in range(rounds.first_dimensions):
            signs[0, c, 0] = -1.0 if (start >> c) & 1 else 1.0
        for source, target in ((x, y), (y, x))[: rounds.sides]:
            turned = source._replace(searched=signs * source.searched)
            search_maps(turned, target, one_start, rotations, correlations)
            for rotation in rotations:
                refined = rotation.copy() if source is x else rotation.T.copy()
                score, forward, _ = _refined(
                    x, y, rounds.align_samples, ROUGH, 1 + rounds.align_rounds, refined
                )
                maps.append(refined)
                scores.append(score)
                partners.append(forward)
    return np.array(maps), np.array(scores, dtype=np.float32), np.array(partners)


def _agreements(x: MatchRecord, maps: _Maps, orientations: tuple[Int8s, Int8s], domain: int) -> Floats:
    """Return the agreement of orientation under each map, in one spectral domain, shape (c,)."""
    rotations, _, partners = maps
    first, second = (each.astype(np.float64) for each in orientations)
    low, k = domain * (x.points.shape[1] // len(x.radius)), int(np.sqrt(2.0 * first.shape[1])) + 1
    parts = rotations[:, low : low + k, low : low + k].astype(np.float64)
    return orientation_agreement(first[: partners.shape[1]], second[partners], parts)


def _fitting(maps: _Maps, agreements: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the maps that fit about as well as the best one, and those of them that preserve orientation."""
    scores = maps[1]
    fitting = scores >= scores.max() - FITS_AS_WELL
    return fitting, fitting & (agreements > 0.0)


def _composed(x: MatchRecord, y: MatchRecord, rounds: SearchRounds, maps: _Maps, *, of_second: bool) -> _Maps:
    """Return the best maps after the symmetries of the first shape, or before those of the second, refined.

    The search from one shape to the other may miss a map of a symmetric shape. The symmetries are the maps of
    the shape to itself; a pose may hide them on one shape and show them on the other.
    """
    symmetries = _maps(y, y, rounds) if of_second else _maps(x, x, rounds)
    turns, ends = (
        each[0][_different(each[2], np.argsort(-each[1], kind="stable"), SYMMETRIES)]
        for each in (symmetries, maps)
    )
    rotations = np.array([end @ turn if of_second else turn @ end for turn in turns for end in ends])
    count = 1 + rounds.align_rounds
    refined = [_refined(x, y, rounds.align_samples, ROUGH, count, rotation) for rotation in rotations]
    scores, partners = (
        np.array([each[0] for each in refined], np.float32),
        np.array([each[1] for each in refined]),
    )
    kept = scores >= maps[1].max() - COMPOSED_FITS
    return rotations[kept], scores[kept], partners[kept]


def _joined(first: _Maps, second: _Maps) -> _Maps:
    """Return the maps of both."""
    rotations, scores, partners = (np.concatenate(pair) for pair in zip(first, second, strict=True))
    return rotations, scores, partners


def _different(partners: Int32s, order: Ints, most: int) -> list[int]:
    """Return the first maps in an order, at most `most`, none like one before it."""
    chosen: list[int] = []
    for which in order.tolist():
        if len(chosen) < most and not any(
            (partners[which] == partners[before]).mean() >= ALIKE for before in chosen
        ):
            chosen.append(which)
    return chosen
