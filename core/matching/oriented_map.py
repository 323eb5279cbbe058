"""Several maps between two shapes, and among them those that preserve orientation.

Eigenfunctions do not tell a surface from its mirror image, so the best map of a symmetric shape may exchange
left and right, or front and back. The searches from all signs find the other maps that fit about as well, and
the signed areas of `core.spectral.orientation` tell which of them preserve orientation.
"""

from dataclasses import dataclass

import numpy as np

from core.arrays import Float32s, Int8s, Int32s
from core.matching.kernels.match_record import MatchRecord
from core.matching.kernels.orthogonal_procrustes import EXACT
from core.matching.kernels.pair_matching import SearchRounds, refine_map
from core.matching.kernels.sign_starts import maps_of_starts
from core.spectral.orientation import orientation_agreement

FITS_AS_WELL = 0.02
"""A map fits about as well as the best one if its correlation is less by at most this: between poses of one
body, maps that exchange left and right differ from the others by up to 0.01."""

AGREEMENT_WEIGHT = 0.02
"""How much the agreement of signed areas counts beside the correlation, where maps are ordered."""

ALIKE = 0.8
"""Two maps are one if they pair at least this share of the samples alike."""


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
    m, n = len(x.offsets) - 1, len(y.offsets) - 1
    blocks, columns = len(x.radius), x.points.shape[1]
    number = rounds.sides * blocks * rounds.starts
    rotations = np.zeros((number, columns, columns), dtype=np.float32)
    scores = np.empty(number, dtype=np.float32)
    partners = np.empty((number, min(rounds.align_samples, m)), dtype=np.int32)
    maps_of_starts(x, y, rounds, rotations, scores, partners)
    first, second = (each.astype(np.float64) for each in orientations)
    low, k = block * (columns // blocks), int(np.sqrt(2.0 * first.shape[1])) + 1
    parts = rotations[:, low : low + k, low : low + k].astype(np.float64)
    agreements = orientation_agreement(first[: partners.shape[1]], second[partners], parts)
    fitting = scores >= scores.max() - FITS_AS_WELL
    preserving = fitting & (agreements > 0.0)
    mirrored = not preserving.any()
    order = np.argsort(-(scores + AGREEMENT_WEIGHT * np.abs(agreements)), kind="stable")
    chosen: list[int] = []
    for which in order[(fitting if mirrored else preserving)[order]]:
        if len(chosen) < most and not any(
            (partners[which] == partners[one]).mean() >= ALIKE for one in chosen
        ):
            chosen.append(int(which))
    found = CandidateMaps([rotations[which] for which in chosen], [], [], mirrored)
    mine, yours = x.points[:m], y.points[:n]
    targets = np.ascontiguousarray(yours.T)
    for rotation in found.rotations:
        found.there.append(np.empty(m, dtype=np.int32))
        found.back.append(np.empty(n, dtype=np.int32))
        count = max(1, rounds.final_rounds + rounds.slides)
        refine_map(mine, yours, targets, blocks, count, EXACT, rotation, found.there[-1], found.back[-1])
    return found
