"""The default matching: nearest neighbours both ways under orthogonal maps, compiled (`core.matching.kernels`)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from core.arrays import Floats, Int16s, Ints
from core.embedding import Embedding
from core.matching.kernels.match_record import ONE, Packed, opened
from core.matching.kernels.pair_matching import Rounds, match_pair
from core.matching.similarity import EFFECTIVE
from core.matching.spline_operators import smoothing
from core.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Matched:
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


def pack(embedding: Embedding, key: bytes, parameters: Parameters) -> Packed:
    """What the compiled matching reads of one shape, in arrays that are contiguous and its own.

    Arrays of another layout would compile the kernels anew, to slower loops.

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
    return Packed(
        points=np.ascontiguousarray(np.concatenate(clouds, axis=1), dtype=np.float32),
        searched=np.ascontiguousarray(np.stack([points.T for points in searched]), dtype=np.float32),
        operators=_whole(
            [
                smoothing(one, parameters.matching.first_dimensions, parameters.matching.stiffness)
                for one in searched
            ]
        ),
        offsets=np.searchsorted(np.sort(regions), np.arange(m + 1)).astype(np.int32),
        members=np.argsort(regions, kind="stable").astype(np.int32),
        warp=_whole([smoothing(one, one.shape[1], parameters.matching.warp_stiffness)[0] for one in samples]),
        radius=np.array([np.linalg.norm(points, axis=1).mean() for points in centred], dtype=np.float32),
        key=np.frombuffer(key, dtype=">u4").astype(np.uint32).view(np.int32),
    )


def _whole(matrices: Sequence[Floats]) -> Int16s:
    """Matrices of entries in [-1, 1], stacked, in whole numbers over `ONE`."""
    return np.rint(np.clip(np.stack(matrices), -1.0, 1.0) * ONE).astype(np.int16)


def rounds_of(parameters: Parameters) -> Rounds:
    """How long the parameters have the compiled matching search."""
    return Rounds(
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


def matched(first: Packed, second: Packed, parameters: Parameters, *, same: bool) -> Matched:
    """Two shapes matched; `same` says that both are one, which is then not searched for its symmetries."""
    scores = np.empty(3)
    rotation = np.empty((first.points.shape[1],) * 2, dtype=np.float32)
    match_pair(
        first,
        second,
        rounds_of(parameters),
        same,
        np.empty(len(first.offsets) - 1, dtype=np.int32),
        np.empty(len(second.offsets) - 1, dtype=np.int32),
        rotation,
        scores,
    )
    return Matched(scores, rotation)


def shown_pairs(
    first: Packed, second: Packed, rotation: NDArray[np.float32], *, same: bool
) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """One-to-one pairs of samples for people to look at: those of least total squared distance under the map.

    Parameters
    ----------
    first, second : Packed
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
    distances = np.linalg.norm(opened(first.warp[0]) @ y - y, axis=1)
    if m == n:
        inverse = np.argsort(matches)
        back = np.linalg.norm(opened(second.warp[0]) @ x[inverse] - x[inverse], axis=1)
        distances = 0.5 * (distances + back[matches])
    gamma = EFFECTIVE * 0.5 * float(first.radius[0] + second.radius[0])
    return matches.astype(np.int64), distances, distances <= gamma
