"""Matching two spectra: the same both ways, perfect against itself, bounded, with clouds of any two sizes."""

from dataclasses import replace

import numpy as np
import pytest

from core.matching.kernels.match_record import decoded
from core.matching.match_records import embedding_key
from core.matching.matcher import matcher_of
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from tests.core.matching.clouds import cloud, embedded
from tests.gallery import make_shape

SETTINGS = {"default": DEFAULT, "paper": PAPER}

SHAPES = [("spider", 0), ("spider", 1), ("octopus", 0), ("hand", 0)]


def by_hand(parameters, count, seed):
    """A cloud for each domain."""
    rng = np.random.default_rng(seed)
    return [cloud(rng, count, parameters.spectral.dimensions) for _ in parameters.spectral.operators]


def ready(clouds, parameters):
    made = embedded(clouds, len(clouds[0]))
    return matcher_of(parameters).prepare(made, embedding_key(made))


def match(first, second, parameters):
    return matcher_of(parameters).match(first, second)


def samples(prepared, parameters):
    """How many samples a prepared shape has."""
    return (
        len(decoded(prepared).offsets) - 1 if parameters.matching.pairs == "both-ways" else prepared.samples
    )


@pytest.fixture(scope="module", params=SETTINGS)
def prepared(request):
    """A setting and the first spectra of several shapes under it, factored; then clouds made by hand."""
    parameters = SETTINGS[request.param]
    pipeline = Pipeline(parameters)
    clouds = [pipeline.prepared(pipeline.embed(make_shape(*shape))) for shape in SHAPES]
    clouds += [ready(by_hand(parameters, count, count), parameters) for count in (60, 45, 100)]
    return parameters, clouds


def test_both_ways_round_are_equal_to_the_bit(prepared):
    parameters, clouds = prepared
    for i, first in enumerate(clouds):
        for second in clouds[:i]:
            there = match(first, second, parameters)
            back = match(second, first, parameters)
            assert (there.cc, there.ssd, there.sim) == (back.cc, back.ssd, back.sim)
            order = np.lexsort((back.correspondence[:, 0], back.correspondence[:, 1]))
            other = np.lexsort((there.correspondence[:, 1], there.correspondence[:, 0]))
            assert np.array_equal(there.correspondence[other], back.correspondence[order][:, ::-1])
            assert np.array_equal(there.distances[other], back.distances[order])
            assert np.array_equal(there.effective[other], back.effective[order])


def test_scores_are_in_their_ranges_and_pairs_are_samples(prepared):
    parameters, clouds = prepared
    for first in clouds:
        for second in clouds:
            found = match(first, second, parameters)
            assert -1.0 <= found.cc <= 1.0
            assert found.ssd >= 0.0
            assert 0.0 <= found.sim <= 1.0
            assert len(found.correspondence) == len(found.distances) == len(found.effective)
            assert len(found.correspondence) == min(samples(first, parameters), samples(second, parameters))
            assert found.correspondence.min() >= 0
            assert (
                found.correspondence.max(axis=0) < [samples(one, parameters) for one in (first, second)]
            ).all()
            assert (found.distances >= 0.0).all()
            kept = found.correspondence[found.effective]
            assert len(np.unique(kept[:, 0])) == len(np.unique(kept[:, 1])) == len(kept)


def test_a_shape_matches_itself_perfectly(prepared):
    parameters, clouds = prepared
    for shape in clouds:
        found = match(shape, shape, parameters)
        assert found.cc == pytest.approx(1.0, abs=1e-6)
        assert found.ssd == pytest.approx(0.0, abs=1e-6)
        assert found.sim == pytest.approx(1.0, abs=1e-6)
        assert (found.correspondence[:, 0] == found.correspondence[:, 1]).all()
        assert found.distances == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_cloud_turned_over_and_in_another_order_is_found(seed):
    rng = np.random.default_rng(seed)
    clouds = by_hand(DEFAULT, 70, 20 + seed)
    order = rng.permutation(70)
    signs = [rng.choice(np.float32([-1, 1]), size=DEFAULT.spectral.dimensions) for _ in clouds]
    copies = [(points * flip)[order] for points, flip in zip(clouds, signs, strict=True)]
    found = match(ready(clouds, DEFAULT), ready(copies, DEFAULT), DEFAULT)
    assert found.cc == pytest.approx(1.0, abs=1e-6)
    assert found.ssd == pytest.approx(0.0, abs=1e-6)
    assert found.sim == 1.0
    assert (order[found.correspondence[:, 1]] == found.correspondence[:, 0]).all()


def test_part_of_a_cloud_is_found_in_the_whole():
    whole = by_hand(DEFAULT, 90, 31)
    kept = np.sort(np.random.default_rng(32).permutation(90)[:80])
    part = [points[kept] for points in whole]
    for first, second, inner, outer in ((part, whole, 0, 1), (whole, part, 1, 0)):
        found = match(ready(first, DEFAULT), ready(second, DEFAULT), DEFAULT)
        assert found.cc > 0.97
        assert (kept[found.correspondence[:, inner]] == found.correspondence[:, outer]).mean() > 0.95


def test_one_correspondence_has_to_suit_every_domain():
    """Two domains that agree each with a copy, but under different orders: no one order suits both."""
    clouds = by_hand(DEFAULT, 60, 5)
    torn = [clouds[0], clouds[1][np.random.default_rng(6).permutation(60)]]
    assert match(ready(clouds, DEFAULT), ready(torn, DEFAULT), DEFAULT).cc < 0.9
    for pair in zip(clouds, torn, strict=True):
        alone = [ready([points], DEFAULT) for points in pair]
        assert match(*alone, DEFAULT).cc == pytest.approx(1.0, abs=1e-6)


def test_a_match_record_has_the_key_of_its_embedding():
    made = embedded(by_hand(DEFAULT, 30, 3), 30)
    key = embedding_key(made)
    record = decoded(matcher_of(DEFAULT).prepare(made, key))
    assert record.key.tobytes() == np.frombuffer(key, ">u4").astype(np.uint32).tobytes()


def test_the_key_is_of_the_coordinates_and_the_regions():
    one, other = (embedded(by_hand(DEFAULT, 30, seed), 30) for seed in (1, 2))
    spectra = tuple(replace(spectrum, coordinates=spectrum.coordinates.copy()) for spectrum in one.spectra)
    named = replace(one, spectra=spectra, fingerprint="other")
    assert embedding_key(one) == embedding_key(named)
    assert embedding_key(one) != embedding_key(other)
    assert embedding_key(one) != embedding_key(replace(one, regions=one.regions % 20))
    assert len(embedding_key(one)) == 16
