"""The compiled matching in plain NumPy, float64 throughout, to compare the kernels with.

The two may differ if rounding decides between two neighbours, or if a map is not determined.
"""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Ints, Reals
from core.embedding import Embedding
from core.matching.kernels.match_record import HEAD, ONE, ROOT, MatchRecord
from core.matching.kernels.procrustes import EXACT, ROUGH
from core.matching.kernels.simd import SIMD_WIDTH
from core.matching.kernels.spline_search import SearchRounds
from core.matching.quantised_points import encoded_points
from core.matching.similarity import correlation, squared_difference
from core.matching.thin_plate_spline import compiled_spline_operators
from core.matching.tps_matcher import spline_search
from core.parameters import Parameters


def nearest_both_ways_reference(rotated: Floats, targets: Floats) -> tuple[Ints, Ints]:
    """The plain form of `nearest_both_ways`, with exact squared distances."""
    squares = ((rotated[:, None, :] - targets[None, :, :]) ** 2).sum(axis=2)
    return np.asarray(squares.argmin(axis=1)), np.asarray(squares.argmin(axis=0))


def nearest_rotation_reference(matrix: Floats, steps: Float32s) -> tuple[float, Floats]:
    """The plain form of `nearest_rotation`, for a matrix (k, k), by its singular values."""
    left, sigma, right = np.linalg.svd(matrix)
    size = np.linalg.norm(sigma)
    ends = sigma / size if size > 0.0 else sigma
    for a, b, c in steps.astype(np.float64):
        ends = a * ends + b * ends**3 + c * ends**5
    return float(sigma @ ends), left * ends @ right


def fit_rotation_reference(
    points: Floats, targets: Floats, blocks: int, steps: Float32s = EXACT
) -> tuple[float, Floats]:
    """The plain form of `fit_rotation`, for paired points: the correlation and the map.

    Parameters
    ----------
    points, targets : float64, shape (p, blocks k)
    """
    rotation = np.zeros((points.shape[1], points.shape[1]))
    score = 0.0
    for columns in np.split(np.arange(points.shape[1]), blocks):
        x = points[:, columns] - points[:, columns].mean(axis=0)
        y = targets[:, columns] - targets[:, columns].mean(axis=0)
        trace, rotation[np.ix_(columns, columns)] = nearest_rotation_reference(x.T @ y, steps)
        size = np.sqrt((x**2).sum() * (y**2).sum())
        score += trace / size / blocks if size > 0.0 else 0.0
    return float(score), rotation


def nearest_columns_reference(points: Reals, targets: Reals, k: int) -> Ints:
    """The nearest of targets, shape (>= k, n), to each of the points, shape (>= k, p), in k rows."""
    return nearest_both_ways_reference(points[:k].T.astype(np.float64), targets[:k].T)[0]


def signless_correlation_reference(points: Reals, targets: Reals, matches: Ints, k: int) -> float:
    """Correlation of points (>= k, p) with their matches among targets (>= k, n), column signs aside."""
    x, y = points[:k].astype(np.float64), targets[:k, matches].astype(np.float64)
    x, y = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    size = np.sqrt((x**2).sum() * (y**2).sum())
    return float(np.abs((x * y).sum(axis=1)).sum() / size) if size > 0.0 else 0.0


def closest_reference(points: Reals, members: NDArray[np.integer], start: int, stop: int, x: Reals) -> int:
    """The one of the rows members[start:stop] of points, shape (d, k), that is closest to x, shape (k,)."""
    rows = members[start:stop]
    return int(rows[((points[rows].astype(np.float64) - x) ** 2).sum(axis=1).argmin()])


def cross_covariance_reference(
    points: Reals, partners: Reals, sources: Reals, targets: Reals, blocks: int
) -> tuple[Floats, Floats, Floats]:
    """Cross-covariance (b k, b k) and centred square sums (b,) of pairs (m, b k) and pairs (n, b k)."""
    x = np.concatenate([points, sources], dtype=np.float64)
    y = np.concatenate([partners, targets], dtype=np.float64)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    first, second = ((side**2).sum(axis=0).reshape(blocks, -1).sum(axis=1) for side in (x, y))
    return x.T @ y, first, second


def search_maps_reference(x: MatchRecord, y: MatchRecord, rounds: SearchRounds) -> tuple[Floats, Floats]:
    """Scores (sides b,) and maps (sides b, b k, b k): of a search in each domain, there and back."""
    blocks = len(x.searched)
    found = []
    for domain in range(blocks):
        for one, other in ((x, y), (y, x))[: rounds.sides]:
            matches = spline_search(
                one.searched[domain].T.astype(np.float64),
                other.searched[domain].T.astype(np.float64),
                one.operators[domain][:, :, : one.searched.shape[2]].astype(np.float64),
                starts=rounds.starts,
                kept_starts=1,
                start_iterations=rounds.start_iterations,
                step_iterations=rounds.step_iterations,
            )
            mine = one.points[: len(matches)].astype(np.float64)
            theirs = other.points[matches].astype(np.float64)
            found.append(
                fit_rotation_reference(*((mine, theirs) if one is x else (theirs, mine)), blocks, ROUGH)
            )
    return np.array([score for score, _ in found]), np.stack([rotation for _, rotation in found])


def refine_map_reference(
    x: Floats, y: Floats, blocks: int, count: int, steps: Float32s, rotation: Floats
) -> tuple[float, Floats, Ints, Ints]:
    """Correlation, map (b k, b k) and the pairs it was fitted to, (m,) and (n,), after `count` >= 1 rounds.

    Clouds are of shapes (m, b k) and (n, b k).
    """
    for _ in range(count):
        there, back = nearest_both_ways_reference(x @ rotation, y)
        score, rotation = fit_rotation_reference(
            np.concatenate([x, x[back]]), np.concatenate([y[there], y]), blocks, steps
        )
    return score, rotation, there, back


def best_map_reference(x: MatchRecord, y: MatchRecord, rounds: SearchRounds) -> tuple[float, Floats]:
    """The best correlation, and its map (b k, b k), of maps searched for and refined on the first samples."""
    blocks = len(x.searched)
    some, others = (
        each.points[: min(rounds.align_samples, len(each.offsets) - 1)].astype(np.float64) for each in (x, y)
    )
    _, maps = search_maps_reference(x, y, rounds)
    tries = [refine_map_reference(some, others, blocks, 1, ROUGH, rotation) for rotation in maps]
    tries = sorted(tries, key=lambda one: -one[0])[: rounds.kept_maps]
    if rounds.align_rounds:
        tries = [
            refine_map_reference(some, others, blocks, rounds.align_rounds, ROUGH, one[1]) for one in tries
        ]
    return max(((score, rotation) for score, rotation, _, _ in tries), key=lambda end: end[0])


def moved(warp: Float32s, points: Floats) -> Floats:
    """How far a softer spline moves points (m, k), from its entries below the diagonal."""
    spline = (warp + warp.T).astype(np.float64)
    np.fill_diagonal(spline, 1.0 - spline.sum(axis=1))
    return np.asarray(np.linalg.norm(spline @ points - points, axis=1))


def score_pairs_reference(
    x: MatchRecord,
    y: MatchRecord,
    there: Ints,
    back: Ints,
    partners: Floats,
    sources: Floats,
    rotation: Floats,
    effective: float,
) -> Floats:
    """CC, SSD and sim, shape (3,), by `core.matching.similarity`; arguments as in `score_pairs`."""
    m, n = len(there), len(back)
    ends = np.concatenate([x.points[:m], sources]) @ rotation
    targets = np.concatenate([partners, y.points[:n]])
    scores = []
    first, second = np.split(targets - ends, [m])
    for block, columns in enumerate(np.split(np.arange(x.points.shape[1]), len(x.radius))):
        gamma = effective * 0.5 * (float(x.radius[block]) + float(y.radius[block]))
        shares = []
        for warp, misses, matches in ((x.warp, first, there), (y.warp, second, back)):
            near = moved(warp[block], misses[:, columns]) <= gamma
            shares.append(len(np.unique(matches[near])) / min(m, n))
        one, other = ends[:, columns], targets[:, columns]
        scores.append((correlation(one, other), squared_difference(one, other), 0.5 * sum(shares)))
    return np.asarray(np.mean(scores, axis=0))


def fit_map_reference(
    x: MatchRecord, y: MatchRecord, rounds: SearchRounds
) -> tuple[float, Ints, Ints, Floats, Floats, Floats]:
    """CC, partners' samples there (m,) and back (n,), partners, sources and map: the results of `fit_map`."""
    blocks = len(x.searched)
    points, others = x.points.astype(np.float64), y.points.astype(np.float64)
    mine, yours = points[: len(x.offsets) - 1], others[: len(y.offsets) - 1]
    _, rotation = best_map_reference(x, y, rounds)
    score, rotation, there, back = refine_map_reference(
        mine, yours, blocks, rounds.final_rounds, EXACT, rotation
    )
    partners, sources = yours[there], mine[back]
    for _ in range(rounds.slides):
        ends, starts = mine @ rotation, yours @ rotation.T
        partners = others[_slid(others, y, there, ends)]
        sources = points[_slid(points, x, back, starts)]
        score, rotation = fit_rotation_reference(
            np.concatenate([mine, sources]), np.concatenate([partners, yours]), blocks
        )
    return score, there, back, partners, sources, rotation


def match_pair_reference(
    x: MatchRecord, y: MatchRecord, rounds: SearchRounds
) -> tuple[Ints, Ints, Floats, Floats]:
    """Partners there (m,) and back (n,), map (b k, b k) and scores (3,), of `fit_map` and `score_pairs`."""
    _, there, back, partners, sources, rotation = fit_map_reference(x, y, rounds)
    scores = score_pairs_reference(x, y, there, back, partners, sources, rotation, rounds.effective)
    return there, back, rotation, scores


def _slid(points: Floats, shape: MatchRecord, regions: Ints, ends: Floats) -> list[int]:
    """The row of points, shape (d, b k), nearest to each end in its own region."""
    offsets = shape.offsets
    return [
        closest_reference(points, shape.members, offsets[region], offsets[region + 1], end)
        for region, end in zip(regions, ends, strict=True)
    ]


def padded(rows: Float32s) -> Float32s:
    """Rows, shape (..., k), and zeros up to whole vectors, shape (..., w)."""
    width = -(-rows.shape[-1] // SIMD_WIDTH) * SIMD_WIDTH
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], width - rows.shape[-1]), np.float32)], axis=-1)


def match_record_reference(embedding: Embedding, key: bytes, parameters: Parameters) -> MatchRecord:
    """The arrays of a match record, before they are one array."""
    regions, wanted = embedding.regions.astype(np.int64), parameters.matching
    m = int(regions.max()) + 1
    rows, columns = wanted.search_samples or m, wanted.search_dimensions or None
    clouds = [spectrum.coordinates.astype(np.float64) for spectrum in embedding.spectra]
    samples = [points[:m] for points in clouds]
    searched = [points[:rows, :columns] for points in samples]
    splines = [compiled_spline_operators(p, wanted.first_dimensions, wanted.stiffness) for p in searched]
    softer = [compiled_spline_operators(p, p.shape[1], wanted.warp_stiffness)[0] for p in samples]
    whole = np.clip(np.rint(np.tril(splines, -1) * ONE), -ONE / 2, ONE / 2)
    whole += np.swapaxes(whole, -1, -2)
    whole += np.eye(whole.shape[-1]) * (ONE - whole.sum(axis=-1, keepdims=True))
    roots = np.rint(np.cbrt(np.tril(softer, -1)) * ROOT).astype(np.float32)
    roots *= np.float32(1.0 / ROOT)
    centred = [points - points.mean(axis=0) for points in samples]
    return MatchRecord(
        points=np.concatenate(clouds, axis=1).astype(np.float32),
        searched=np.array([points.T for points in searched], dtype=np.float32, order="C"),
        operators=padded(whole.astype(np.float32) * np.float32(1.0 / ONE)),
        offsets=np.searchsorted(np.sort(regions), np.arange(m + 1)).astype(np.int32),
        members=np.argsort(regions, kind="stable").astype(np.int32),
        warp=roots * roots * roots,
        radius=np.array([np.linalg.norm(points, axis=1).mean() for points in centred], dtype=np.float32),
        key=np.frombuffer(key, dtype=">u4").astype(np.uint32).view(np.int32),
    )


def encoded_reference(record: MatchRecord) -> Float32s:
    """The arrays of a match record as one array."""
    b, j, s = record.searched.shape
    m, (d, columns) = len(record.offsets) - 1, record.points.shape
    regions = np.empty(d, dtype=np.int32)
    regions[record.members] = np.repeat(np.arange(m), np.diff(record.offsets))
    points = encoded_points(record.points, regions)
    head = np.zeros(HEAD, dtype=np.int32)
    head[:7] = m, len(points), s, b, columns // b, j, record.operators.shape[1]
    head[7:11] = record.key
    entries = np.rint(record.operators[..., :s][..., np.tri(s, k=-1) > 0.0] * ONE).astype(int).ravel()
    eighths = np.append(entries, [0] * (-len(entries) % 8)).reshape(8, -1)
    pairs_of_bits = [eighths[7] % 2**14 // 4**part % 4 for part in range(7)]
    operators = (4 * eighths[:7] + pairs_of_bits).astype(np.int16)
    warp = np.rint(np.cbrt(record.warp[..., np.tri(m, k=-1) > 0.0]) * ROOT).astype(np.int8)
    parts = head.tobytes(), record.radius.tobytes(), points, operators.tobytes(), warp.tobytes()
    return np.frombuffer(b"".join(part + bytes(-len(part) % 4) for part in parts), dtype=np.float32)
