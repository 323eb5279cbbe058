"""Where the search begins: neighbours by columns, correlation whatever the signs, the spline search."""

import numpy as np
import pytest

from core.matching.correspondence import spline_search as plain_search
from core.matching.kernels.match_record import ONE
from core.matching.kernels.spline_search import (
    nearest_columns,
    signless_correlation,
    spline_search,
)
from core.matching.numpy_reference import nearest_columns_reference, signless_correlation_reference
from core.matching.spline_operators import spline_operators
from tests.core.matching.clouds import cloud

SCALES = [1e-12, 1e-3, 1.0, 1e5, 1e12]


def columns(seed, count, k, scale=1.0):
    return np.ascontiguousarray(cloud(np.random.default_rng(seed), count, k).T) * np.float32(scale)


def nearest(points, targets, k, low):
    found = np.empty(points.shape[1], dtype=np.int32)
    nearest_columns(points, targets, k, low, found)
    return found


def distances(points, targets, k):
    step = points[:k, :, None].astype(np.float64) - targets[:k, None, :]
    return (step**2).sum(axis=0)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("p", "n"), [(2, 2), (7, 30), (100, 32), (64, 100)])
@pytest.mark.parametrize("k", [2, 3, 6, 12])
def test_the_nearest_column_is_the_plain_one_but_for_the_bits_that_are_left_out(k, p, n, scale):
    points, targets = columns(k, p, 12, scale), columns(100 + k, n, 12, scale)
    found = nearest(points, targets, k, 128)
    expected = nearest_columns_reference(points, targets, k)
    squares = distances(points, targets, k)
    chosen, least = squares[np.arange(p), found], squares[np.arange(p), expected]
    assert (chosen <= least * (1 + 128 * 2.0**-23 + 1e-5)).all()
    assert (found == expected).mean() > 0.98


@pytest.mark.parametrize("low", [128, 1024, 16384])
def test_so_many_targets_that_their_numbers_take_up_to_fourteen_bits(low):
    n = low - 1
    points, targets = columns(1, 50, 3), columns(2, n, 3)
    found = nearest(points, targets, 3, low)
    squares = distances(points, targets, 3)
    least = squares.min(axis=1)
    assert (squares[np.arange(50), found] <= least * (1 + low * 2.0**-23 + 1e-5)).all()
    separate = np.sort(squares, axis=1)[:, 1] > least * (1 + 2 * low * 2.0**-23)
    assert separate.sum() > 25
    assert np.array_equal(found[separate], nearest_columns_reference(points, targets, 3)[separate])


def test_the_first_of_equally_near_targets_is_taken():
    targets = np.repeat(columns(3, 10, 4), 3, axis=1)
    assert np.array_equal(nearest(targets, targets, 4, 128), np.repeat(np.arange(0, 30, 3), 3))
    one = np.zeros((4, 20), dtype=np.float32)
    assert np.array_equal(nearest(one, one, 4, 128), np.zeros(20))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("k", [2, 3, 6, 12])
def test_the_correlation_whatever_the_signs_is_the_plain_one(k, scale):
    for seed in range(5):
        points, targets = columns(seed, 50, 12, scale), columns(20 + seed, 33, 12)
        matches = np.random.default_rng(seed).integers(33, size=50).astype(np.int32)
        found = signless_correlation(points, targets, matches, k)
        assert found == pytest.approx(signless_correlation_reference(points, targets, matches, k), abs=1e-5)


def test_columns_of_any_signs_correlate_fully_with_themselves():
    points = columns(4, 40, 6)
    flipped = points * np.float32([1, -1, -1, 1, -1, 1])[:, None]
    order = np.random.default_rng(5).permutation(40)
    matches = np.argsort(order).astype(np.int32)
    found = signless_correlation(points, np.ascontiguousarray(flipped[:, order]), matches, 6)
    assert found == pytest.approx(1.0, abs=1e-6)


def test_points_all_matched_to_one_do_not_correlate():
    points, targets = columns(6, 30, 4), np.zeros((4, 30), dtype=np.float32)
    for matches in (np.zeros(30, dtype=np.int32), np.arange(30, dtype=np.int32)):
        assert signless_correlation(points, targets, matches, 4) == 0.0
        assert signless_correlation(targets, points, matches, 4) == 0.0


def whole(points, first):
    """Splines of points by columns, in whole numbers."""
    splines = spline_operators(np.ascontiguousarray(points.T).astype(np.float64), first, 100.0)
    return np.rint(splines * ONE).astype(np.int16)


@pytest.mark.parametrize(("starts", "first"), [(8, 3), (1, 3), (4, 2), (1, 2)])
@pytest.mark.parametrize(("m", "n"), [(30, 30), (25, 40), (32, 12), (8, 50)])
def test_the_search_is_the_plain_one(m, n, starts, first):
    for seed in range(4):
        points, targets = columns(seed, m, 6), columns(40 + seed, n, 6)
        operators = whole(points, first)
        found = np.empty(m, dtype=np.int32)
        spline_search(points, targets, operators, first, starts, 2, 2, 128, found)
        expected = plain_search(
            points.T.astype(np.float64),
            targets.T.astype(np.float64),
            operators / ONE,
            starts=starts,
            kept_starts=1,
            start_iterations=2,
            step_iterations=2,
        )
        assert np.array_equal(found, expected)


def test_the_search_leaves_what_it_reads_and_finds_the_same_twice():
    points, targets = columns(7, 32, 6), columns(8, 30, 6)
    operators = whole(points, 3)
    kept = [array.copy() for array in (points, targets, operators)]
    found = np.empty((2, 32), dtype=np.int32)
    for row in found:
        spline_search(points, targets, operators, 3, 8, 1, 1, 128, row)
    assert np.array_equal(*found)
    for array, before in zip((points, targets, operators), kept, strict=True):
        assert np.array_equal(array, before)
