"""Partners that slide off the samples: against the plain reference, and on clouds whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from core.gallery import make_shape
from core.matching import match_prepared
from core.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.sliding import cloud, slide, slide_reference


def scattered(seed, *, samples=30, points=150, dimensions=4):
    """Points about samples, each with the nearest sample as its region, and the samples that are close."""
    rng = np.random.default_rng(seed)
    everything = rng.normal(size=(points, dimensions)) * 0.7 ** np.arange(dimensions)
    gaps = np.linalg.norm(everything[:, None] - everything[None, :samples], axis=2)
    near = gaps[:samples] < 1.0
    return everything, gaps.argmin(axis=1), np.argwhere(np.triu(near, 1))


def turn(seed, dimensions=4):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(dimensions, dimensions)))[0]


def test_near_a_sample_are_the_points_of_its_region_and_of_those_that_touch_it():
    points, regions, edges = scattered(0)
    made = cloud(points, regions, edges)
    for i in range(30):
        near = made.near[made.offsets[i] : made.offsets[i + 1]]
        touching = {i} | {int(b if a == i else a) for a, b in edges if i in (a, b)}
        assert near.tolist() == [p for p in range(150) if regions[p] in touching]
    assert made.offsets[-1] == len(made.near)
    assert made.nbytes == made.points.nbytes + made.offsets.nbytes + made.near.nbytes


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rounds", [1, 2, 5])
@pytest.mark.parametrize("blocks", [1, 2])
def test_the_compiled_slide_is_the_reference(seed, rounds, blocks):
    rng = np.random.default_rng(seed)
    first, second = cloud(*scattered(10 + seed)), cloud(*scattered(20 + seed, samples=36, points=120))
    matches = rng.permutation(36)[:30]
    rotation = turn(seed)
    found = slide(first, second, matches, rotation, rounds, blocks)
    expected = slide_reference(first, second, matches, rotation, rounds, blocks)
    assert found.cc == pytest.approx(expected.cc, abs=1e-9)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-9)
    np.testing.assert_array_equal(found.y, expected.y)


@pytest.mark.parametrize("seed", range(4))
def test_one_cloud_with_other_samples_is_matched_exactly(seed):
    """Every sample of the one is a point of the other, and near: so all pairs coincide after the map."""
    points, regions, _ = scattered(seed, samples=12)
    everyone = np.argwhere(np.triu(np.ones((12, 12)), 1))
    order = np.random.default_rng(seed).permutation(len(points))
    rotation = turn(seed)
    first = cloud(points, regions, everyone)
    second = cloud((points @ rotation)[order], np.r_[np.arange(12), regions[12:]], everyone)
    found = slide(first, second, np.arange(12), rotation, 2, 1)
    assert found.cc == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(found.x, found.y, atol=1e-9)


def test_clouds_of_one_place_correlate_to_nothing():
    still = np.zeros((6, 3))
    regions = np.arange(6)
    edges = np.stack([regions[:-1], regions[1:]], axis=1)
    flat = cloud(still, regions, edges)
    assert slide(flat, flat, regions, np.eye(3), 2, 1).cc == 0.0


def test_sliding_brings_a_shape_meshed_anew_closer_to_itself():
    pipeline = Pipeline(DEFAULT)
    mesh = make_shape("hand", 0)
    finer = Mesh(*trimesh.remesh.subdivide(mesh.vertices, mesh.faces))
    clouds = [pipeline.prepared(pipeline.embed(shape)) for shape in (mesh, finer)]
    slid = match_prepared(*clouds, DEFAULT).cc
    still = match_prepared(*clouds, replace(DEFAULT, slide_rounds=0)).cc
    assert 1.0 - slid < 0.5 * (1.0 - still)
