"""The search for initial maps: correlation whatever the signs, the spline search, the maps of both sides."""

import numpy as np
import pytest

from core.matching.kernels.spline_search import search_maps, signless_correlation, spline_search
from core.matching.match_records import search_rounds
from core.matching.thin_plate_spline import spline_operators
from core.matching.tps_matcher import spline_search as plain_search
from tests.core.matching.clouds import columns, parameters_for, random_record
from tests.core.matching.reference import padded, search_maps_reference, signless_correlation_reference


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("k", [2, 3, 6, 12])
def test_the_correlation_whatever_the_signs_is_the_plain_one(k, scale):
    for seed in range(5):
        points, targets = columns(seed, 50, 12, scale), columns(20 + seed, 33, 12)
        matches = np.random.default_rng(seed).integers(33, size=50).astype(np.int32)
        found = signless_correlation(points, targets, matches, k)
        assert found == pytest.approx(signless_correlation_reference(points, targets, matches, k), abs=1e-5)


def test_points_all_matched_to_one_do_not_correlate():
    points, targets = columns(6, 30, 4), np.zeros((4, 30), dtype=np.float32)
    for matches in (np.zeros(30, dtype=np.int32), np.arange(30, dtype=np.int32)):
        assert signless_correlation(points, targets, matches, 4) == 0.0
        assert signless_correlation(targets, points, matches, 4) == 0.0


def splines_of(points, first):
    """Splines of points by columns, in rows of whole vectors."""
    return padded(spline_operators(np.ascontiguousarray(points.T).astype(np.float64), first, 100.0))


@pytest.mark.parametrize(("starts", "first"), [(8, 3), (1, 3), (4, 2), (1, 2)])
@pytest.mark.parametrize(("m", "n"), [(30, 30), (25, 40), (32, 12), (8, 50)])
def test_the_search_is_the_plain_one(m, n, starts, first):
    for seed in range(4):
        points, targets = columns(seed, m, 6), columns(40 + seed, n, 6)
        operators = splines_of(points, first)
        found = np.empty(m, dtype=np.int32)
        spline_search(points, targets, operators, first, starts, 2, 2, 128, found)
        expected = plain_search(
            points.T.astype(np.float64),
            targets.T.astype(np.float64),
            operators[..., :m].astype(np.float64),
            starts=starts,
            kept_starts=1,
            start_iterations=2,
            step_iterations=2,
        )
        assert np.array_equal(found, expected)


def searched(x, y, rounds):
    columns = x.points.shape[1]
    rotations = np.zeros((rounds.sides * len(x.radius), columns, columns), dtype=np.float32)
    scores = np.zeros(len(rotations))
    search_maps(x, y, rounds, rotations, scores)
    return scores, rotations


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "n"), [(40, 100), (100, 24)])
@pytest.mark.parametrize("k", [2, 5, 10])
@pytest.mark.parametrize("sides", [1, 2])
def test_maps_searched_for_are_the_plain_ones(k, m, n, blocks, sides):
    x, y = random_record(k, m, m + 20, k, blocks), random_record(30 + k, n, n, k, blocks)
    rounds = search_rounds(parameters_for(k))._replace(sides=sides)
    scores, rotations = searched(x, y, rounds)
    plain_scores, plain = search_maps_reference(x, y, rounds)
    assert scores == pytest.approx(plain_scores, abs=1e-5)
    assert rotations == pytest.approx(plain, abs=5e-3)
    for one in range(blocks):
        own = slice(one * k, one * k + k)
        assert not np.delete(rotations[:, own], np.r_[own], axis=2).any()
