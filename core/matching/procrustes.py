"""The Procrustes matcher, the default: nearest neighbours both ways under orthogonal maps.

The loops are compiled: `core.matching.kernels`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from core.arrays import Float32s, Floats, Int8s, Int16s, Ints
from core.embedding import Embedding, Scores
from core.matching.kernels.match_record import ONE, MatchRecord, decoded, dequantised, encoded
from core.matching.kernels.one_to_many import match_many, precedes
from core.matching.kernels.pair_matching import SearchRounds, match_pair
from core.matching.matcher import PairMatch
from core.matching.oriented_map import CandidateMaps, candidate_maps
from core.matching.similarity import EFFECTIVE
from core.matching.spline_operators import compiled_spline_operators
from core.parameters import Parameters
from core.spectral.orientation import ORIENTING

TOGETHER = 32
"""Match records that are copied into one array for one call of the kernel."""


@dataclass(frozen=True, eq=False)
class ProcrustesMatch:
    """Two shapes matched, of m and n samples.

    Attributes
    ----------
    scores : float64, shape (3,)
        CC, SSD and sim.
    rotation : float32, shape (b k, b k)
        The orthogonal map: points of the first times it lie on those of the second.
    """

    scores: Floats
    rotation: NDArray[np.float32]


def make_match_record(embedding: Embedding, key: bytes, parameters: Parameters) -> MatchRecord:
    """The match record of one shape, in contiguous arrays that share no memory with the embedding.

    For arrays of another layout numba would compile the kernels again, to slower loops.

    Parameters
    ----------
    embedding : Embedding
    key : bytes
        16, a hash of it: see `core.matching.matcher.embedding_key`.
    parameters : Parameters
    """
    regions = embedding.regions.astype(np.int64)
    m = int(regions.max()) + 1
    rows = min(parameters.matching.search_samples or m, m)
    columns = parameters.matching.search_dimensions or parameters.spectral.dimensions
    clouds = [spectrum.coordinates.astype(np.float64) for spectrum in embedding.spectra]
    samples = [points[:m] for points in clouds]
    searched = [points[:rows, :columns] for points in samples]
    centred = [points - points.mean(axis=0) for points in samples]
    return MatchRecord(
        points=np.ascontiguousarray(np.concatenate(clouds, axis=1), dtype=np.float32),
        searched=np.ascontiguousarray(np.stack([points.T for points in searched]), dtype=np.float32),
        operators=_quantised(
            [
                compiled_spline_operators(
                    one, parameters.matching.first_dimensions, parameters.matching.stiffness
                )
                for one in searched
            ]
        ),
        offsets=np.searchsorted(np.sort(regions), np.arange(m + 1)).astype(np.int32),
        members=np.argsort(regions, kind="stable").astype(np.int32),
        warp=_quantised(
            [
                compiled_spline_operators(one, one.shape[1], parameters.matching.warp_stiffness)[0]
                for one in samples
            ]
        ),
        radius=np.array([np.linalg.norm(points, axis=1).mean() for points in centred], dtype=np.float32),
        key=np.frombuffer(key, dtype=">u4").astype(np.uint32).view(np.int32),
    )


def _quantised(matrices: Sequence[Floats]) -> Int16s:
    """Matrices of entries in [-1, 1], stacked, in whole numbers over `ONE`."""
    return np.rint(np.clip(np.stack(matrices), -1.0, 1.0) * ONE).astype(np.int16)


def search_rounds(parameters: Parameters) -> SearchRounds:
    """The numbers of rounds that the parameters ask for."""
    return SearchRounds(
        parameters.matching.first_dimensions,
        2**parameters.matching.first_dimensions if parameters.matching.sign_starts else 1,
        parameters.matching.start_iterations,
        parameters.matching.step_iterations,
        2,
        parameters.matching.align_samples,
        parameters.matching.kept_maps,
        parameters.matching.align_rounds,
        parameters.matching.final_rounds,
        parameters.matching.slide_rounds,
        EFFECTIVE,
    )


def procrustes_match(
    first: MatchRecord, second: MatchRecord, parameters: Parameters, *, same: bool
) -> ProcrustesMatch:
    """Two shapes matched. `same`: both are one shape, which is then not searched for its symmetries."""
    scores = np.empty(3)
    rotation = np.empty((first.points.shape[1],) * 2, dtype=np.float32)
    match_pair(
        first,
        second,
        search_rounds(parameters),
        same,
        np.empty(len(first.offsets) - 1, dtype=np.int32),
        np.empty(len(second.offsets) - 1, dtype=np.int32),
        rotation,
        scores,
    )
    return ProcrustesMatch(scores, rotation)


def one_to_one_pairs(
    first: MatchRecord, second: MatchRecord, rotation: NDArray[np.float32], *, same: bool
) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """One-to-one pairs of samples, of least total squared distance under the map, to be shown to people.

    Parameters
    ----------
    first, second : MatchRecord
        Of m <= n samples.
    rotation : float32, shape (b k, b k)
    same : bool
        Whether both are one shape: then each sample's partner is itself.

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
    x, y = ends[:, :k], targets[matches, :k]
    distances = np.linalg.norm(dequantised(first.warp[0]) @ y - y, axis=1)
    if m == n:
        inverse = np.argsort(matches)
        back = np.linalg.norm(dequantised(second.warp[0]) @ x[inverse] - x[inverse], axis=1)
        distances = 0.5 * (distances + back[matches])
    gamma = EFFECTIVE * 0.5 * float(first.radius[0] + second.radius[0])
    return matches.astype(np.int64), distances, distances <= gamma


class ProcrustesMatcher:
    """The default matcher: one orthogonal map for all domains, and nearest neighbours both ways under it.

    CC, SSD and sim read each sample's nearest partner, from either shape; the pairs that are shown are
    one-to-one. A prepared shape is an encoded match record, float32, shape (l,).
    """

    uses_match_records = True

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def prepare(self, embedding: Embedding, key: bytes) -> Float32s:
        """The match record of an embedding, whose `core.matching.matcher.embedding_key` is `key`."""
        return encoded(make_match_record(embedding, key, self._parameters))

    def score(self, query: Float32s, candidates: Iterable[Float32s]) -> Scores:
        """CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""
        records = list(candidates)
        scores = np.empty((len(records), 3))
        for start in range(0, len(records), TOGETHER):
            batch = records[start : start + TOGETHER]
            match_many(
                _own(query),
                np.concatenate(batch, dtype=np.float32, casting="no"),
                np.cumsum([len(record) for record in batch]),
                search_rounds(self._parameters),
                scores[start : start + TOGETHER],
            )
        return Scores(cc=scores[:, 0].copy(), ssd=scores[:, 1].copy(), sim=scores[:, 2].copy())

    def match(
        self, first: Float32s, second: Float32s, orientations: tuple[Int8s, Int8s] | None = None
    ) -> PairMatch:
        """The scores of two shapes, and one-to-one pairs of their samples.

        With orientations the pairs are those of a map that preserves orientation, if one fits about as well
        as the best map.
        """
        x, y = decoded(first), decoded(second)
        order = precedes(x, y)
        if order < 0:
            x, y = y, x
        found = procrustes_match(x, y, self._parameters, same=order == 0)
        rotation, mirrored = found.rotation, None if orientations is None else False
        # A mirror image with the same triangles has the same samples, in the same order.
        same = order == 0 and not (orientations is not None and _opposite(*orientations))
        if orientations is not None and not same:
            ordered = (orientations[1], orientations[0]) if order < 0 else orientations
            maps = self._candidates(x, y, ordered, 1)
            rotation, mirrored = maps.rotations[0], maps.mirrored
        matches, distances, effective = one_to_one_pairs(x, y, rotation, same=same)
        cc, ssd, sim = found.scores.tolist()
        pairs = np.stack([np.arange(len(matches)), matches], axis=1)
        match = PairMatch(cc, ssd, sim, pairs, distances, effective, mirrored)
        return match.swapped() if order < 0 else match

    def candidates(
        self, first: Float32s, second: Float32s, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], bool | None]:
        """Pairs of samples under each of several maps, at most `most`, best first.

        Each has the nearest neighbours both ways, shape (m + n, 2); all maps have one orientation, and the
        second value says whether they reverse it.
        """
        x, y = decoded(first), decoded(second)
        if precedes(x, y) == 0 and not _opposite(*orientations):
            return [np.repeat(np.arange(len(x.offsets) - 1)[:, None], 2, axis=1)], False
        maps = self._candidates(x, y, orientations, most)
        here, there = np.arange(len(x.offsets) - 1), np.arange(len(y.offsets) - 1)
        pairs = [
            np.concatenate([np.stack([here, forth], axis=1), np.stack([back, there], axis=1)])
            for forth, back in zip(maps.there, maps.back, strict=True)
        ]
        return pairs, maps.mirrored

    def _candidates(
        self, x: MatchRecord, y: MatchRecord, orientations: tuple[Int8s, Int8s], most: int
    ) -> CandidateMaps:
        block = self._parameters.spectral.operators.index(ORIENTING)
        return candidate_maps(x, y, orientations, block, search_rounds(self._parameters), most)


def _opposite(first: Int8s, second: Int8s) -> bool:
    """Whether the signed areas of the same samples have opposite signs in the mean."""
    return bool((first.astype(np.int64) * second).sum() < 0)


def _own(query: Float32s) -> Float32s:
    """The match record in memory that may be written to: numba would compile the kernels again for others."""
    return np.require(query, requirements=["C", "W"])
