"""One map for each sign start of each search; `pair_matching.search_maps` keeps the best start alone.

A symmetric shape has several maps that fit equally well: the searches from other signs find them.
"""

import numpy as np

from core.arrays import Float32s, Int32s
from core.matching.kernels.match_record import MatchRecord
from core.matching.kernels.nearest_neighbours import cross_covariance, gather
from core.matching.kernels.orthogonal_procrustes import ROUGH, fit_rotation
from core.matching.kernels.pair_matching import SearchRounds, lowest_bits, refine_map
from core.matching.kernels.spline_search import spline_search
from core.numerics.compilation import kernel


@kernel
def maps_of_starts(
    x: MatchRecord,
    y: MatchRecord,
    rounds: SearchRounds,
    rotations: Float32s,
    scores: Float32s,
    there: Int32s,
) -> None:
    """Write the map of each start, refined on the first samples.

    Parameters
    ----------
    x, y : MatchRecord
    rounds : SearchRounds
    rotations : float32, shape (sides b starts, b k, b k)
        Zeros; written where blocks meet themselves.
    scores : float32, shape (sides b starts,)
        Written: correlations of the samples after the maps.
    there : int32, shape (sides b starts, s)
        Written: the partner of each of the first s samples of x.
    """
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]
    some = x.points[: there.shape[1]]
    others = y.points[: min(rounds.align_samples, len(y.offsets) - 1)]
    aligned = np.ascontiguousarray(others.T)
    back = np.empty(len(others), dtype=np.int32)
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    none = np.empty((0, columns), dtype=np.float32)
    for which in range(len(scores)):
        start = which % rounds.starts
        domain = which // rounds.starts // rounds.sides
        forth = which // rounds.starts % rounds.sides == 0
        one = x if forth else y
        other = y if forth else x
        points = one.searched[domain].copy()
        for c in range(rounds.first_dimensions):
            if (start >> c) & 1:
                points[c] = -points[c]
        s = points.shape[1]
        matches = np.empty(s, dtype=np.int32)
        spline_search(
            points,
            other.searched[domain],
            one.operators[domain],
            rounds.first_dimensions,
            1,
            rounds.start_iterations,
            rounds.step_iterations,
            lowest_bits(other.searched.shape[2]),
            matches,
        )
        found = np.empty((s, columns), dtype=np.float32)
        gather(other.points, matches, found)
        if forth:
            cross_covariance(x.points[:s], found, none, none, blocks, covariance, first, second)
        else:
            cross_covariance(found, y.points[:s], none, none, blocks, covariance, first, second)
        fit_rotation(covariance, first, second, ROUGH, rotations[which])
        count = 1 + rounds.align_rounds
        scores[which] = refine_map(
            some, others, aligned, blocks, count, ROUGH, rotations[which], there[which], back
        )
