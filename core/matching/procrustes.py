"""The Procrustes matcher, the default: nearest neighbours both ways under orthogonal maps.

The loops are compiled: `core.matching.kernels`.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from core.arrays import Float32s, Floats, Int8s, Ints
from core.embedding import Embedding, Match, Scores
from core.matching.kernels.match_record import MatchRecord, decoded, precedes
from core.matching.kernels.one_to_many import MATCH_RECORD
from core.matching.match_records import compared, keyed_match_record, score_match_records, search_rounds
from core.matching.oriented_map import CandidateMaps, candidate_maps
from core.matching.similarity import EFFECTIVE
from core.parameters import Parameters
from core.spectral.orientation import ORIENTING


def one_to_one_pairs(
    first: MatchRecord, second: MatchRecord, rotation: NDArray[np.float32], *, same: bool
) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """Return one-to-one pairs of samples, of least total squared distance under the map, for people to see.

    The shapes have m <= n samples. If both are the same shape, each sample's partner is itself.

    Returns
    -------
    int64, shape (m,)
        A sample of the second for each of the first, all different.
    float64, shape (m,)
        How far the softer spline of the first domain leaves each from its partner; where m = n, the mean of
        both ways.
    bool, shape (m,)
        Whether that is within gamma.
    """
    m, n = len(first.offsets) - 1, len(second.offsets) - 1
    k = first.points.shape[1] // len(first.radius)
    ends = (first.points[:m] @ rotation).astype(np.float64)
    targets = second.points[:n].astype(np.float64)
    matches = np.arange(m)
    if not same:
        matches = linear_sum_assignment(cdist(ends, targets, "sqeuclidean"))[1]
    misses = (targets[matches] - ends)[:, :k]
    distances = _left(first, misses)
    if m == n:
        distances = 0.5 * (distances + _left(second, misses[np.argsort(matches)])[matches])
    gamma = EFFECTIVE * 0.5 * float(first.radius[0] + second.radius[0])
    return matches.astype(np.int64), distances, distances <= gamma


def _left(shape: MatchRecord, misses: Floats) -> Floats:
    """Return how far the softer spline of the first domain leaves samples from their partners, shape (m,).

    It reproduces affine maps, so the differences of pairs after the map, shape (m, k), tell.
    """
    lower = shape.warp[0].astype(np.float64)
    others = lower + lower.T
    return np.asarray(np.linalg.norm(others @ misses - others.sum(axis=1)[:, None] * misses, axis=1))


class ProcrustesMatcher:
    """The default matcher: one orthogonal map for all domains, and nearest neighbours both ways under it.

    CC, SSD and sim read each sample's nearest partner, from either shape; the pairs that are shown are
    one-to-one. A prepared shape is an encoded match record, float32, shape (l,).
    """

    uses_match_records = True

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def prepare(self, embedding: Embedding, key: bytes) -> Float32s:
        """Return the match record of an embedding, whose `embedding_key` is `key`."""
        return keyed_match_record(embedding, key, self._parameters)

    def score(self, query: Float32s, candidates: Iterable[Float32s]) -> Scores:
        """Return CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""
        return score_match_records(query, list(candidates), self._parameters)

    def match(
        self, first: Float32s, second: Float32s, orientations: tuple[Int8s, Int8s] | None = None
    ) -> Match:
        """Return the scores of two shapes, and one-to-one pairs of their samples.

        With orientations the pairs are those of a map that preserves orientation, if one fits about as well
        as the best map.
        """
        x, y = (decoded(np.require(record, requirements=["C", "W"])) for record in (first, second))
        order = precedes(x, y)
        if order < 0:
            x, y = y, x
        data, ends = second.view(np.uint8), np.array([second.nbytes])
        scores, rotation = compared(first, data, ends, MATCH_RECORD, search_rounds(self._parameters))
        mirrored = None if orientations is None else False
        # A mirror image with the same triangles has the same samples, in the same order.
        same = order == 0 and not (orientations is not None and _opposite(*orientations))
        if orientations is not None and not same:
            ordered = (orientations[1], orientations[0]) if order < 0 else orientations
            maps = self._candidates(x, y, ordered, 1)
            rotation, mirrored = maps.rotations[0], maps.image
        matches, distances, effective = one_to_one_pairs(x, y, rotation, same=same)
        cc, ssd, sim = scores[0].tolist()
        pairs = np.stack([np.arange(len(matches)), matches], axis=1).astype(np.int32)
        match = Match(cc, ssd, sim, pairs, distances.astype(np.float32), effective, mirrored)
        return match.swapped() if order < 0 else match

    def candidates(
        self, first: Float32s, second: Float32s, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], list[bool]]:
        """Return pairs of samples under each map of `core.matching.oriented_map.candidate_maps`.

        Each has the nearest neighbours both ways, shape (m + n, 2). The second list says which maps reverse
        orientation.
        """
        x, y = (decoded(np.require(record, requirements=["C", "W"])) for record in (first, second))
        samples_of_x, samples_of_y = np.arange(len(x.offsets) - 1), np.arange(len(y.offsets) - 1)
        if precedes(x, y) == 0 and not _opposite(*orientations):
            return [np.repeat(samples_of_x[:, None], 2, axis=1)], [False]
        maps = self._candidates(x, y, orientations, most)
        pairs = [
            np.concatenate([np.stack([samples_of_x, forward], 1), np.stack([backward, samples_of_y], 1)])
            for forward, backward in zip(maps.forward, maps.backward, strict=True)
        ]
        return pairs, maps.mirrored

    def _candidates(
        self, x: MatchRecord, y: MatchRecord, orientations: tuple[Int8s, Int8s], most: int
    ) -> CandidateMaps:
        domain = self._parameters.spectral.operators.index(ORIENTING)
        return candidate_maps(x, y, orientations, domain, search_rounds(self._parameters), most)


def _opposite(first: Int8s, second: Int8s) -> bool:
    """Return whether the signed areas of the same samples have opposite signs in the mean."""
    return bool((first.astype(np.int64) * second).sum() < 0)
