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
from core.matching.kernels.orthogonal_procrustes import EXACT, ROUGH
from core.matching.kernels.pair_matching import SearchRounds, refine_map
from core.matching.kernels.sign_starts import maps_of_starts
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
"""Largest number of maps of the first shape to itself, and of maps between both, that are composed."""

_Maps = tuple[Float32s, Float32s, Int32s]
"""Rotations (c, b k, b k), scores (c,) and partners (c, s) of the first samples, of c maps."""


@dataclass(frozen=True, eq=False)
class CandidateMaps:
    """Different maps from a shape of m samples to one of n samples that fit about equally well, best first.

    Attributes
    ----------
    rotations : list of float32, shape (b k, b k)
        As in `core.matching.procrustes.ProcrustesMatch`.
    there, back : list of int32, shapes (m,) and (n,)
        The partner of each sample of the first shape, and of the second.
    mirrored : bool
        Whether they reverse orientation, since no map that fits about as well preserves it.
    """

    rotations: list[Float32s]
    there: list[Int32s]
    back: list[Int32s]
    mirrored: bool


def candidate_maps(
    x: MatchRecord,
    y: MatchRecord,
    orientations: tuple[Int8s, Int8s],
    block: int,
    rounds: SearchRounds,
    most: int,
) -> CandidateMaps:
    """At most `most` maps, all of one orientation: preserving, if such a map fits about as well as any.

    Parameters
    ----------
    x, y : MatchRecord
        Of m and n samples.
    orientations : pair of int8, shapes (m, e) and (n, e)
        Of their embeddings.
    block : int
        The spectral domain whose coordinates they belong to.
    rounds : SearchRounds
    most : int
        >= 1.
    """
    maps = _maps(x, y, rounds)
    agreements = _agreements(x, maps, orientations, block)
    fitting, preserving = _fitting(maps, agreements)
    if most > 1 or not preserving.any():
        maps = _joined(maps, _composed(x, y, rounds, maps))
        agreements = _agreements(x, maps, orientations, block)
        fitting, preserving = _fitting(maps, agreements)
    mirrored = not preserving.any()
    rotations, scores, partners = maps
    order = np.argsort(-(scores + AGREEMENT_WEIGHT * np.abs(agreements)), kind="stable")
    chosen = _different(partners, order[(fitting if mirrored else preserving)[order]], most)
    found = CandidateMaps([rotations[which] for which in chosen], [], [], mirrored)
    m, n = len(x.offsets) - 1, len(y.offsets) - 1
    mine, yours = x.points[:m], y.points[:n]
    targets = np.ascontiguousarray(yours.T)
    for rotation in found.rotations:
        found.there.append(np.empty(m, dtype=np.int32))
        found.back.append(np.empty(n, dtype=np.int32))
        count = max(1, rounds.final_rounds + rounds.slides)
        refine_map(
            mine, yours, targets, len(x.radius), count, EXACT, rotation, found.there[-1], found.back[-1]
        )
    return found


def _maps(x: MatchRecord, y: MatchRecord, rounds: SearchRounds) -> _Maps:
    """The map of each start of each search."""
    m, blocks, columns = len(x.offsets) - 1, len(x.radius), x.points.shape[1]
    number = rounds.sides * blocks * rounds.starts
    rotations = np.zeros((number, columns, columns), dtype=np.float32)
    scores = np.empty(number, dtype=np.float32)
    partners = np.empty((number, min(rounds.align_samples, m)), dtype=np.int32)
    maps_of_starts(x, y, rounds, rotations, scores, partners)
    return rotations, scores, partners


def _agreements(x: MatchRecord, maps: _Maps, orientations: tuple[Int8s, Int8s], block: int) -> Floats:
    """The agreement of orientation under each map, in one spectral domain, shape (c,)."""
    rotations, _, partners = maps
    first, second = (each.astype(np.float64) for each in orientations)
    low, k = block * (x.points.shape[1] // len(x.radius)), int(np.sqrt(2.0 * first.shape[1])) + 1
    parts = rotations[:, low : low + k, low : low + k].astype(np.float64)
    return orientation_agreement(first[: partners.shape[1]], second[partners], parts)


def _fitting(maps: _Maps, agreements: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The maps that fit about as well as the best one, and those of them that preserve orientation."""
    scores = maps[1]
    fitting = scores >= scores.max() - FITS_AS_WELL
    return fitting, fitting & (agreements > 0.0)


def _composed(x: MatchRecord, y: MatchRecord, rounds: SearchRounds, maps: _Maps) -> _Maps:
    """The best maps after the symmetries of the first shape, refined.

    The search from one shape to the other may miss a map of a symmetric shape. The symmetries are the maps of
    the shape to itself.
    """
    blocks = len(x.radius)
    own = _maps(x, x, rounds)
    turns, ends = (
        each[0][_different(each[2], np.argsort(-each[1], kind="stable"), SYMMETRIES)] for each in (own, maps)
    )
    some = x.points[: maps[2].shape[1]]
    others = y.points[: min(rounds.align_samples, len(y.offsets) - 1)]
    targets = np.ascontiguousarray(others.T)
    rotations = np.array([turn @ end for turn in turns for end in ends])
    partners = np.empty((len(rotations), len(some)), dtype=np.int32)
    back = np.empty(len(others), dtype=np.int32)
    count = 1 + rounds.align_rounds
    scores = [
        refine_map(some, others, targets, blocks, count, ROUGH, rotation, there, back)
        for rotation, there in zip(rotations, partners, strict=True)
    ]
    kept = np.array(scores) >= maps[1].max() - COMPOSED_FITS
    return rotations[kept], np.array(scores, dtype=np.float32)[kept], partners[kept]


def _joined(one: _Maps, other: _Maps) -> _Maps:
    return (
        np.concatenate([one[0], other[0]]),
        np.concatenate([one[1], other[1]]),
        np.concatenate([one[2], other[2]]),
    )


def _different(partners: Int32s, order: Ints, most: int) -> list[int]:
    """The first maps in an order, at most `most`, none like one before it."""
    chosen: list[int] = []
    for which in order.tolist():
        if len(chosen) < most and not any(
            (partners[which] == partners[one]).mean() >= ALIKE for one in chosen
        ):
            chosen.append(which)
    return chosen
