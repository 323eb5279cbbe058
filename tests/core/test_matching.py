"""Matching two spectra: the same both ways, perfect against itself, bounded, with clouds of any two sizes."""

from dataclasses import replace

import numpy as np
import pytest

from core.alignment import procrustes
from core.embedding import Spectrum
from core.gallery import make_shape
from core.matching import match_spectra, prepare, spectrum_key
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.similarity import correlation

SETTINGS = {"default": DEFAULT, "paper": PAPER}

SHAPES = [("spider", 0), ("spider", 1), ("octopus", 0), ("hand", 0)]


def by_hand(parameters, count, seed):
    """A cloud as embeddings hold them: centred, unit root mean square radius, weaker from one to the next."""
    points = np.random.default_rng(seed).normal(size=(count, parameters.dimensions))
    points *= 0.8 ** np.arange(parameters.dimensions)
    points -= points.mean(axis=0)
    points /= np.sqrt((points**2).sum(axis=1).mean())
    return Spectrum("affinity", np.ones(20, dtype=np.float32), points.astype(np.float32))


def ready(spectrum, parameters):
    """A cloud of samples alone, each touching the next."""
    regions = np.arange(len(spectrum.coordinates), dtype=np.int32)
    edges = np.stack([regions[:-1], regions[1:]], axis=1)
    return prepare(spectrum, regions, edges, spectrum_key(spectrum, regions), parameters)


@pytest.fixture(scope="module", params=SETTINGS)
def prepared(request):
    """A setting and the first spectra of several shapes under it, factored; then clouds made by hand."""
    parameters = SETTINGS[request.param]
    pipeline = Pipeline(parameters)
    clouds = [pipeline.prepared(pipeline.embed(make_shape(*shape)), 0) for shape in SHAPES]
    clouds += [ready(by_hand(parameters, count, count), parameters) for count in (60, 45, 100)]
    return parameters, clouds


def identical(one, other):
    return (
        (one.cc, one.ssd, one.sim) == (other.cc, other.ssd, other.sim)
        and np.array_equal(one.pairs, other.pairs)
        and np.array_equal(one.distances, other.distances)
        and np.array_equal(one.effective, other.effective)
    )


def test_both_ways_round_are_equal_to_the_bit(prepared):
    parameters, clouds = prepared
    for i, first in enumerate(clouds):
        for second in clouds[:i]:
            there = match_spectra(first, second, parameters)
            back = match_spectra(second, first, parameters)
            assert (there.cc, there.ssd, there.sim) == (back.cc, back.ssd, back.sim)
            order = np.lexsort((back.pairs[:, 0], back.pairs[:, 1]))
            other = np.lexsort((there.pairs[:, 1], there.pairs[:, 0]))
            assert np.array_equal(there.pairs[other], back.pairs[order][:, ::-1])
            assert np.array_equal(there.distances[other], back.distances[order])
            assert np.array_equal(there.effective[other], back.effective[order])


def test_scores_are_in_their_ranges_and_pairs_are_samples(prepared):
    parameters, clouds = prepared
    for first in clouds:
        for second in clouds:
            found = match_spectra(first, second, parameters)
            assert -1.0 <= found.cc <= 1.0
            assert found.ssd >= 0.0
            assert 0.0 <= found.sim <= 1.0
            assert len(found.pairs) == len(found.distances) == len(found.effective)
            assert len(found.pairs) == min(len(first.points), len(second.points))
            assert found.pairs.min() >= 0
            assert (found.pairs.max(axis=0) < [len(first.points), len(second.points)]).all()
            assert (found.distances >= 0.0).all()


def test_the_same_match_twice_is_the_same(prepared):
    parameters, clouds = prepared
    again = match_spectra(clouds[0], clouds[2], parameters)
    assert identical(match_spectra(clouds[0], clouds[2], parameters), again)


def test_swapping_twice_changes_nothing(prepared):
    parameters, clouds = prepared
    found = match_spectra(clouds[0], clouds[1], parameters).swapped()
    assert identical(found.swapped().swapped(), found)


def test_a_shape_matches_itself_perfectly(prepared):
    parameters, clouds = prepared
    for cloud in clouds:
        found = match_spectra(cloud, cloud, parameters)
        assert found.cc == pytest.approx(1.0, abs=1e-6)
        assert found.ssd == pytest.approx(0.0, abs=1e-6)
        assert found.sim == pytest.approx(1.0, abs=1e-6)
        assert (found.pairs[:, 0] == found.pairs[:, 1]).all()
        assert found.distances == pytest.approx(0.0, abs=1e-4)


def test_pairs_of_the_default_are_one_to_one():
    clouds = [ready(by_hand(DEFAULT, count, count), DEFAULT) for count in (30, 50, 50, 80)]
    for first in clouds:
        for second in clouds:
            pairs = match_spectra(first, second, DEFAULT).pairs
            assert len(pairs) == min(len(first.points), len(second.points))
            assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs)


def test_effective_pairs_are_one_to_one(prepared):
    parameters, clouds = prepared
    for first in clouds:
        for second in clouds:
            found = match_spectra(first, second, parameters)
            kept = found.pairs[found.effective]
            assert len(np.unique(kept[:, 0])) == len(np.unique(kept[:, 1])) == len(kept)


@pytest.mark.parametrize("seed", range(4))
def test_a_cloud_turned_over_and_in_another_order_is_found(seed):
    rng = np.random.default_rng(seed)
    spectrum = by_hand(DEFAULT, 70, 20 + seed)
    order = rng.permutation(70)
    signs = rng.choice(np.float32([-1, 1]), size=DEFAULT.dimensions)
    other = Spectrum("affinity", spectrum.eigenvalues, (spectrum.coordinates * signs)[order])
    found = match_spectra(ready(spectrum, DEFAULT), ready(other, DEFAULT), DEFAULT)
    assert found.cc == pytest.approx(1.0, abs=1e-6)
    assert found.ssd == pytest.approx(0.0, abs=1e-6)
    assert found.sim == 1.0
    assert (order[found.pairs[:, 1]] == found.pairs[:, 0]).all()


def test_part_of_a_cloud_is_found_in_the_whole():
    whole = by_hand(DEFAULT, 90, 31)
    kept = np.sort(np.random.default_rng(32).permutation(90)[:80])
    part = Spectrum("affinity", whole.eigenvalues, np.ascontiguousarray(whole.coordinates[kept]))
    for first, second, inner, outer in ((part, whole, 0, 1), (whole, part, 1, 0)):
        found = match_spectra(ready(first, DEFAULT), ready(second, DEFAULT), DEFAULT)
        assert found.cc == pytest.approx(1.0, abs=1e-3)
        assert (kept[found.pairs[:, inner]] == found.pairs[:, outer]).mean() > 0.95


def test_the_prepared_cloud_is_the_spectrum_and_its_splines(prepared):
    parameters, clouds = prepared
    stages = parameters.dimensions - parameters.first_dimensions + 1
    for cloud in clouds:
        m = len(cloud.points)
        assert cloud.single.dtype == cloud.operators.dtype == np.float32
        assert cloud.operators.shape == (stages, m, m)
        assert cloud.warp.shape == (m, m)
        assert np.array_equal(cloud.points, cloud.single.astype(np.float64))
        assert np.array_equal(cloud.points, cloud.cloud.points[:m])
        assert cloud.nbytes >= m * m * 4 * stages


def test_the_key_is_of_the_coordinates_and_the_regions():
    one, other = by_hand(DEFAULT, 30, 1), by_hand(DEFAULT, 30, 2)
    named = Spectrum("laplace-beltrami", one.eigenvalues * 2, one.coordinates.copy())
    regions = np.arange(30, dtype=np.int32)
    assert spectrum_key(one, regions) == spectrum_key(named, regions)
    assert spectrum_key(one, regions) != spectrum_key(other, regions)
    assert spectrum_key(one, regions) != spectrum_key(one, regions % 20)
    assert len(spectrum_key(one, regions)) == 16


def test_without_sliding_scores_read_the_pairs_of_samples():
    still = replace(DEFAULT, slide_rounds=0)
    first, second = (ready(by_hand(DEFAULT, 50, seed), still) for seed in (1, 2))
    found = match_spectra(first, second, still)
    pairs = found.pairs
    x, y = first.points[pairs[:, 0]], second.points[pairs[:, 1]]
    turned = x @ procrustes(x, y)
    assert found.cc == pytest.approx(correlation(turned, y), abs=1e-9)
    assert match_spectra(first, second, DEFAULT).cc > found.cc
