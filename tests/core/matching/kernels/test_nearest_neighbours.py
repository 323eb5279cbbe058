"""Neighbours both ways, in a region, and the cross-products of pairs."""

import numpy as np
import pytest

from core.matching.kernels.nearest_neighbours import (
    columns_of,
    compact_rows,
    cross_covariance,
    cross_covariance_both_ways,
    mapped,
    nearest_both_ways,
    nearest_columns,
    nearest_member,
    padded_rows,
)
from tests.core.matching.clouds import cloud, columns
from tests.core.matching.reference import (
    closest_reference,
    cross_covariance_reference,
    nearest_both_ways_reference,
    nearest_columns_reference,
    padded,
)


def both(points, targets, low):
    there = np.empty(len(points), dtype=np.int32)
    back = np.empty(len(targets), dtype=np.int32)
    nearest_both_ways(points, columns_of(targets, len(targets)), low, there, back)
    return there, back


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize("k", [1, 2, 10, 15, 16, 33])
@pytest.mark.parametrize("m", [1, 4, 13])
def test_points_of_each_domain_are_mapped(m, k, blocks):
    rng = np.random.default_rng(m)
    points = rng.normal(size=(m + 1, blocks * k)).astype(np.float32)
    rotation = np.zeros((blocks * k, blocks * k), dtype=np.float32)
    for low in range(0, blocks * k, k):
        rotation[low : low + k, low : low + k] = rng.normal(size=(k, k))
    rows = padded_rows(points, m, blocks)
    assert np.array_equal(compact_rows(rows, blocks, k), points[:m])
    found = compact_rows(mapped(rows, rotation, blocks), blocks, k)
    assert found == pytest.approx(points[:m].astype(np.float64) @ rotation, abs=1e-5 * k)


def squared(points, targets):
    return ((points[:, None].astype(np.float64) - targets) ** 2).sum(axis=2)


def precision(low):
    """The last bits, and the rounding, of squared distances of points not far from the unit ball."""
    return low * 2.0**-23, 3e-5 + low * 2.0**-23 * 1e-3


@pytest.mark.parametrize("low", [128, 16384])
@pytest.mark.parametrize(("m", "n"), [(2, 2), (37, 90), (120, 12)])
@pytest.mark.parametrize("k", [2, 7, 20])
def test_mutual_neighbours_are_the_plain_ones_but_for_the_bits_that_are_left_out(k, m, n, low):
    points, targets = cloud(k, m, k), cloud(50 + k, n, k)
    squares = squared(points, targets)
    relative, absolute = precision(low)
    found, plain = both(points, targets, low), nearest_both_ways_reference(points.astype(np.float64), targets)
    for matches, expected, table in zip(found, plain, (squares, squares.T), strict=True):
        places = np.arange(len(table))
        least = table[places, expected]
        assert (table[places, matches] <= least * (1 + relative) + absolute).all()
        step = np.sort(table, axis=1)[:, 1] > least * (1 + relative) + 2 * absolute
        assert np.array_equal(matches[step], expected[step])
        assert step.mean() > 0.3


def test_a_number_for_each_of_so_many_that_fourteen_bits_hold():
    points, targets = cloud(1, 16383, 3), cloud(2, 5, 3)
    there, back = both(points, targets, 16384)
    squares = squared(points, targets)
    relative, absolute = precision(16384)
    assert (squares[np.arange(16383), there] <= squares.min(axis=1) * (1 + relative) + absolute).all()
    assert (squares[back, np.arange(5)] <= squares.min(axis=0) * (1 + relative) + absolute).all()
    assert np.array_equal(both(targets, points, 16384)[0], back)


def test_the_first_of_coincident_points_is_taken():
    points = np.repeat(cloud(4, 10, 6), 3, axis=0)
    for matches in both(points, points, 128):
        assert np.array_equal(matches, np.repeat(np.arange(0, 30, 3), 3))
    one = np.tile(np.float32([0.3, -0.2]), (20, 1))
    for matches in both(one, one, 128):
        assert not matches.any()


def test_distances_of_which_rounding_leaves_less_than_nothing():
    """Points far from the origin, and far nearer to one another than their squares can tell."""
    points = (np.float32(100.0) + 1e-4 * cloud(5, 50, 4)).astype(np.float32)
    for matches in both(points, points, 128):
        assert matches.min() >= 0
        assert matches.max() < 50


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("k", [2, 10, 24])
def test_the_closest_of_a_region_is_the_plain_one(k, scale):
    rng = np.random.default_rng(k)
    points, ends = cloud(k, 80, k) * np.float32(scale), cloud(9, 40, k) * np.float32(scale)
    members = rng.permutation(80).astype(np.int32)
    for start, stop in ((0, 80), (0, 1), (79, 80), (10, 13), (20, 60)):
        for place, end in enumerate(ends):
            found = nearest_member(points, members, start, stop, ends, place)
            assert found == closest_reference(points, members, start, stop, end)
            assert found in members[start:stop]


def test_the_first_of_equally_close_members_is_taken():
    points = np.ones((6, 3), dtype=np.float32)
    members = np.int32([4, 2, 5, 0])
    ends = np.float32([[0, 0, 0], [1, 1, 1]])
    assert nearest_member(points, members, 0, 4, ends, 0) == 4
    assert nearest_member(points, members, 1, 4, ends, 1) == 2


def written(kernel, columns, blocks, *given):
    """What a kernel writes after what it is given: covariances of the domains, square sums of both sides."""
    k = columns // blocks
    results = [np.full(shape, np.nan, dtype=np.float32) for shape in ((blocks, k, k), blocks, blocks)]
    rows = [each if each.ndim == 1 else padded_rows(each, len(each), blocks) for each in given]
    kernel(*rows, *results)
    return results


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("blocks", [1, 2])
@pytest.mark.parametrize(("m", "n"), [(30, 70), (1, 1), (70, 5)])
@pytest.mark.parametrize("k", [2, 10])
def test_cross_products_and_square_sums_are_the_plain_ones(k, m, n, blocks, scale):
    rng = np.random.default_rng(k)
    x, y = (
        (scale * (rng.normal(size=(rows, blocks * k)) + shift)).astype(np.float32)
        for rows, shift in ((m, 0.5), (n, -1.0))
    )
    there, back = rng.integers(n, size=m).astype(np.int32), rng.integers(m, size=n).astype(np.int32)
    pairs = x, y[there], x[back], y
    nothing = np.empty((0, blocks * k), dtype=np.float32)
    for kernel, given, expected in (
        (cross_covariance, pairs, pairs),
        (cross_covariance, (*pairs[:2], nothing, nothing), (*pairs[:2], nothing, nothing)),
        (cross_covariance_both_ways, (x, y, there, back), pairs),
    ):
        before = [array.copy() for array in given]
        found = written(kernel, blocks * k, blocks, *given)
        covariance, *squares = cross_covariance_reference(*expected, blocks)
        own = [covariance[low : low + k, low : low + k] for low in range(0, blocks * k, k)]
        for one, other in zip(found, (np.array(own), *squares), strict=True):
            assert one == pytest.approx(other, abs=5e-6 * scale**2 * (m + n) * k)
        for array, kept in zip(given, before, strict=True):
            assert np.array_equal(array, kept)


def test_pairs_all_of_one_place_have_no_cross_products():
    one = np.tile(np.float32([0.5, -0.25, 2.0, 1.0]), (32, 1))
    for sources in (np.empty((0, 4), dtype=np.float32), one):
        for array in written(cross_covariance, 4, 2, one, one, sources, sources):
            assert not array.any()


SCALES = [1e-12, 1.0, 1e12]


def nearest_column(points, targets, k, low):
    rows = padded(points)
    found = np.empty(rows.shape[1], dtype=np.int32)
    nearest_columns(rows, targets, k, low, found)
    return found[: points.shape[1]]


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("p", "n"), [(2, 2), (7, 30), (64, 100)])
@pytest.mark.parametrize("k", [2, 12])
def test_the_nearest_column_is_the_plain_one_but_for_the_bits_that_are_left_out(k, p, n, scale):
    points, targets = columns(k, p, 12, scale), columns(100 + k, n, 12, scale)
    found = nearest_column(points, targets, k, 128)
    expected = nearest_columns_reference(points, targets, k)
    squares = squared(points[:k].T, targets[:k].T)
    chosen, least = squares[np.arange(p), found], squares[np.arange(p), expected]
    assert (chosen <= least * (1 + 128 * 2.0**-23 + 1e-5)).all()
    assert (found == expected).mean() > 0.98


@pytest.mark.parametrize("low", [128, 16384])
def test_so_many_targets_that_their_numbers_take_up_to_fourteen_bits(low):
    n = low - 1
    points, targets = columns(1, 50, 3), columns(2, n, 3)
    found = nearest_column(points, targets, 3, low)
    squares = squared(points.T, targets.T)
    least = squares.min(axis=1)
    assert (squares[np.arange(50), found] <= least * (1 + low * 2.0**-23 + 1e-5)).all()
    separate = np.sort(squares, axis=1)[:, 1] > least * (1 + 2 * low * 2.0**-23)
    assert separate.sum() > 25
    assert np.array_equal(found[separate], nearest_columns_reference(points, targets, 3)[separate])


def test_the_first_of_equally_near_targets_is_taken():
    targets = np.repeat(columns(3, 10, 4), 3, axis=1)
    assert np.array_equal(nearest_column(targets, targets, 4, 128), np.repeat(np.arange(0, 30, 3), 3))
    one = np.zeros((4, 20), dtype=np.float32)
    assert np.array_equal(nearest_column(one, one, 4, 128), np.zeros(20))
