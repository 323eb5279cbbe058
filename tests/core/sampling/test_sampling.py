"""Samples of a mesh, and closest points of triangles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse.csgraph import dijkstra

from core.graph.edge_graph import edge_graph
from core.graph.geodesics import farthest_points
from core.mesh.box_tree import closest_on_triangles, triangle_tree
from core.mesh.normal_frame import normal_frame
from core.sampling.lewis_weights import lewis_weights
from core.sampling.sampling import (
    draw_scale,
    keyed_uniform,
    random_draw,
    sort_and_cut,
    weighted_farthest_points,
)
from tests.core.shapes import GALLERY, blob, make_shape


def framed(mesh):
    """Graph, points in the normal frame, and their Lewis weights."""
    points = normal_frame(mesh).apply(mesh.vertices)
    return edge_graph(mesh), points, lewis_weights(points).weights


def largest_gap(graph, samples):
    return dijkstra(graph, indices=samples, min_only=True).max()


def uneven(count=60, seed=0):
    """Weights over three decades."""
    return 10.0 ** np.random.default_rng(seed).uniform(-3.0, 0.0, size=count)


def test_the_cut_takes_the_largest_first_and_ties_by_order():
    weights = np.array([0.2, 0.9, 0.2, 0.5, 0.9, 0.2])
    np.testing.assert_array_equal(sort_and_cut(weights, 4), [1, 4, 3, 0])
    np.testing.assert_array_equal(sort_and_cut(weights, 6), [1, 4, 3, 0, 2, 5])
    np.testing.assert_array_equal(sort_and_cut(np.ones(100), 30), np.arange(30))


def test_keyed_numbers_are_roughly_uniform():
    points = np.random.default_rng(1).normal(size=(20_000, 3))
    numbers = keyed_uniform(points, 3)
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    counts = np.bincount((numbers * 20).astype(int), minlength=20)
    # Chi-squared with 19 degrees of freedom: 50.8 is passed once in ten thousand.
    assert ((counts - 1000.0) ** 2 / 1000.0).sum() < 50.8
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.03


def test_keyed_numbers_belong_to_the_place_up_to_rounding():
    points = np.round(np.random.default_rng(2).normal(size=(400, 3)), 4)
    order = np.random.default_rng(3).permutation(400)
    numbers = keyed_uniform(points, 7)
    np.testing.assert_array_equal(keyed_uniform(points[order][:50], 7), numbers[order][:50])
    np.testing.assert_array_equal(keyed_uniform(points + 3e-5, 7), numbers)
    assert (keyed_uniform(points + 1e-4, 7) != numbers).all()


def test_seeds_give_numbers_that_have_nothing_in_common():
    points = np.random.default_rng(5).normal(size=(3000, 3))
    first, second, negative = (keyed_uniform(points, seed) for seed in (0, 1, -1))
    for other in (second, negative):
        assert (first != other).all()
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.08


@pytest.mark.parametrize("count", [1, 5, 20, 45, 59])
@pytest.mark.parametrize("seed", range(5))
def test_the_scale_makes_the_mean_size_of_the_draw(count, seed):
    weights = uneven(seed=seed)
    scale = draw_scale(weights, count)
    assert np.minimum(1.0, scale * weights).sum() == pytest.approx(count)


def test_the_scale_when_weights_are_equal_or_nought():
    assert draw_scale(np.full(10, 0.5), 4) == pytest.approx(0.8)
    some = np.array([0.0, 1.0, 0.0, 3.0, 2.0])
    assert np.minimum(1.0, draw_scale(some, 2) * some).sum() == pytest.approx(2.0)
    for count in (3, 5):
        np.testing.assert_allclose(np.minimum(1.0, draw_scale(some, count) * some), some > 0.0)
    assert np.isfinite(draw_scale(np.zeros(4), 2))


@pytest.mark.parametrize("count", [1, 7, 30, 60])
def test_a_draw_has_exactly_its_count(count):
    for seed in range(20):
        samples = random_draw(uneven(), count, np.random.default_rng(seed).random(60))
        assert len(samples) == len(np.unique(samples)) == count
        assert samples.min() >= 0
        assert samples.max() < 60


def test_a_draw_takes_points_without_weight_last():
    weights = np.repeat([0.0, 1.0], 10)
    samples = random_draw(weights, 10, np.random.default_rng(6).uniform(0.01, 1.0, size=20))
    np.testing.assert_array_equal(np.sort(samples), np.arange(10, 20))


@pytest.mark.parametrize("count", [20, 30, 45])
def test_a_point_that_is_sure_is_always_drawn(count):
    weights = uneven()
    sure = np.flatnonzero(draw_scale(weights, count) * weights >= 1.0)
    assert 0 < len(sure) < count
    for seed in range(300):
        samples = random_draw(weights, count, np.random.default_rng(seed).random(60))
        assert set(sure) <= set(samples)


def test_points_are_drawn_as_often_as_their_probability():
    weights = uneven(200, seed=8)
    points = np.random.default_rng(9).normal(size=(200, 3))
    probability = np.minimum(1.0, draw_scale(weights, 60) * weights)
    seeds = 300
    kept = np.zeros(200)
    for seed in range(seeds):
        kept[random_draw(weights, 60, keyed_uniform(points, seed))] += 1.0
    # Five standard errors, and what the fixed size changes.
    bound = 5.0 * np.sqrt(probability * (1.0 - probability) / seeds) + 0.01
    assert (np.abs(kept / seeds - probability) < bound).all()
    small = probability < 0.2
    assert kept[small].sum() / seeds == pytest.approx(probability[small].sum(), rel=0.1)


def test_a_draw_belongs_to_the_places_and_the_seed():
    _, points, weights = framed(blob())
    order = np.random.default_rng(10).permutation(len(points))
    samples = random_draw(weights, 50, keyed_uniform(points, 1))
    again = random_draw(weights[order], 50, keyed_uniform(points[order], 1))
    np.testing.assert_array_equal(order[again], samples)
    assert set(samples) != set(random_draw(weights, 50, keyed_uniform(points, 2)))


@pytest.mark.parametrize("label", GALLERY)
@pytest.mark.parametrize("power", [0.25, 0.5])
def test_each_sample_is_the_farthest_by_weighted_distance(label, power):
    graph, points, weights = framed(make_shape(label, 0))
    samples = weighted_farthest_points(graph, points, weights, 100, power)
    assert len(samples) == len(np.unique(samples)) == 100
    plain = farthest_points(graph, 100, int(samples[0]))
    assert not np.array_equal(samples, plain)
    relative = np.clip((weights / weights.mean()) ** power, 0.25, 4.0)
    for i in (1, 10, 50, 99):
        distances = relative * dijkstra(graph, indices=samples[:i], min_only=True)
        assert distances[samples[i]] == pytest.approx(distances.max(), rel=1e-9)
    # So no region is left bare: no vertex is farther than the last sample was, by weighted distance.
    assert largest_gap(graph, samples) <= 4.0 * distances.max()


@pytest.mark.parametrize("label", GALLERY[:4])
def test_power_nought_is_plain_farthest_point_sampling(label):
    graph, points, weights = framed(make_shape(label, 0))
    first = int(np.argmax(np.linalg.norm(points, axis=1)))
    np.testing.assert_array_equal(
        weighted_farthest_points(graph, points, weights, 80, 0.0), farthest_points(graph, 80, first)
    )


@pytest.mark.parametrize("power", [0.0, 0.5])
def test_samples_follow_the_vertices(power):
    graph, points, weights = framed(blob())
    order = np.random.default_rng(11).permutation(len(points))
    samples = weighted_farthest_points(graph, points, weights, 60, power)
    again = weighted_farthest_points(graph[order][:, order], points[order], weights[order], 60, power)
    np.testing.assert_array_equal(order[again], samples)


def triangles(count: int, thin: float, seed: int) -> np.ndarray:
    """Random triangles of which some are long and thin, or a line, or a point."""
    draws = np.random.default_rng(seed)
    made = draws.normal(size=(count, 1, 3)) + 0.2 * draws.normal(size=(count, 3, 3))
    made[::3, 2] = made[::3, 1] + thin * draws.normal(size=made[::3, 2].shape)
    made[::7, 2] = made[::7, 1]
    made[::11] = made[::11, :1]
    return made


def gaps_of(triangle: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distances of points from a triangle: from its sides, or from its plane above its inside."""
    gaps = []
    for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        side = end - start
        share = np.clip((points - start) @ side / max(side @ side, 1e-300), 0.0, 1.0)
        gaps.append(np.linalg.norm(start + share[:, None] * side - points, axis=1))
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    turns = [
        np.cross(end - start, points - start) @ normal
        for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
    ]
    inside = np.min(turns, axis=0) > 0.0
    height = np.abs((points - triangle[0]) @ normal) / max(np.linalg.norm(normal), 1e-300)
    return np.where(inside, np.minimum(height, np.min(gaps, axis=0)), np.min(gaps, axis=0))


@pytest.mark.parametrize("count", [1, 5, 100])
@pytest.mark.parametrize("guessed", [False, True])
def test_the_closest_point_is_the_closest_of_all_triangles(count: int, guessed: bool) -> None:
    corners = triangles(count, 1e-3, count)
    points = 2.0 * np.random.default_rng(1).normal(size=(200, 3))
    guess = np.random.default_rng(2).integers(0, count, len(points)) if guessed else None
    shares, faces = triangle_tree(corners).closest(points, guess)
    assert (shares >= -1e-12).all()
    assert_allclose(shares.sum(axis=1), 1.0)
    found = np.einsum("nc,ncx->nx", shares, corners[faces])
    nearest = np.min([gaps_of(triangle, points) for triangle in corners], axis=0)
    assert_allclose(np.linalg.norm(found - points, axis=1), nearest, atol=1e-12)
    everywhere = np.tile(np.arange(count), (len(points), 1))
    again = closest_on_triangles(corners, everywhere, points)
    assert_allclose(np.linalg.norm(again - points, axis=1), nearest, atol=1e-12)
    near = np.random.default_rng(3).uniform(0.0, 2.0, len(points))
    shares, faces = triangle_tree(corners).closest(points, guess, near)
    ends = np.linalg.norm(np.einsum("nc,ncx->nx", shares, corners[faces]) - points, axis=1)
    # A search ends with a point that is near enough, or with the closest one.
    assert (ends <= np.maximum(near, nearest + 1e-12)).all()
    assert len(triangle_tree(corners).closest(points[:0])[1]) == 0
