"""Matching two spectra: the same both ways, perfect against itself, bounded, with clouds of any two sizes."""

from dataclasses import replace

import numpy as np
import pytest

from core.embedding import Embedding, Facts, Spectrum
from core.gallery import make_shape
from core.matching.kernels.match_record import decoded
from core.matching.match_records import embedding_key
from core.matching.matcher import matcher_of
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline

SETTINGS = {"default": DEFAULT, "paper": PAPER}

SHAPES = [("spider", 0), ("spider", 1), ("octopus", 0), ("hand", 0)]


def by_hand(parameters, count, seed):
    """Clouds as embeddings hold them: centred, unit root mean square radius, weaker from one to the next."""
    rng = np.random.default_rng(seed)
    made = []
    for name in parameters.spectral.operators:
        points = rng.normal(size=(count, parameters.spectral.dimensions)) * 0.8 ** np.arange(
            parameters.spectral.dimensions
        )
        points -= points.mean(axis=0)
        points /= np.sqrt((points**2).sum(axis=1).mean())
        made.append(Spectrum(name, np.ones(20, dtype=np.float32), points.astype(np.float32)))
    return tuple(made)


def embedding(spectra):
    """Samples alone, each touching the next."""
    places = np.arange(len(spectra[0].coordinates), dtype=np.int32)
    nothing = np.empty(0, dtype=np.float32)
    return Embedding(
        fingerprint="",
        facts=Facts(3, 1, 1.0, 1.0, 1.0, 1, 0, 0, 3, 0, 0.0),
        positions=np.zeros((len(places), 3), dtype=np.float32),
        vertices=places,
        graph_edges=np.stack([places[:-1], places[1:]], axis=1),
        graph_lengths=nothing,
        tree_edges=np.stack([places[:-1], places[1:]], axis=1),
        regions=places,
        signature=nothing,
        spectra=spectra,
        descriptors={},
    )


def ready(spectra, parameters):
    made = embedding(spectra)
    return matcher_of(parameters).prepare(made, embedding_key(made))


def match(first, second, parameters):
    return matcher_of(parameters).match(first, second)


def samples(prepared, parameters):
    """How many samples a prepared shape has."""
    return (
        len(decoded(prepared).offsets) - 1 if parameters.matching.pairs == "both-ways" else prepared.samples
    )


def changed(spectra, change):
    return tuple(Spectrum(one.name, one.eigenvalues, change(one.coordinates)) for one in spectra)


@pytest.fixture(scope="module", params=SETTINGS)
def prepared(request):
    """A setting and the first spectra of several shapes under it, factored; then clouds made by hand."""
    parameters = SETTINGS[request.param]
    pipeline = Pipeline(parameters)
    clouds = [pipeline.prepared(pipeline.embed(make_shape(*shape))) for shape in SHAPES]
    clouds += [ready(by_hand(parameters, count, count), parameters) for count in (60, 45, 100)]
    return parameters, clouds


def identical(one, other):
    return (
        (one.cc, one.ssd, one.sim) == (other.cc, other.ssd, other.sim)
        and np.array_equal(one.correspondence, other.correspondence)
        and np.array_equal(one.distances, other.distances)
        and np.array_equal(one.effective, other.effective)
    )


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


def test_the_same_match_twice_is_the_same(prepared):
    parameters, clouds = prepared
    again = match(clouds[0], clouds[2], parameters)
    assert identical(match(clouds[0], clouds[2], parameters), again)


def test_swapping_twice_changes_nothing(prepared):
    parameters, clouds = prepared
    found = match(clouds[0], clouds[1], parameters).swapped()
    assert identical(found.swapped().swapped(), found)


def test_a_shape_matches_itself_perfectly(prepared):
    parameters, clouds = prepared
    for cloud in clouds:
        found = match(cloud, cloud, parameters)
        assert found.cc == pytest.approx(1.0, abs=1e-6)
        assert found.ssd == pytest.approx(0.0, abs=1e-6)
        assert found.sim == pytest.approx(1.0, abs=1e-6)
        assert (found.correspondence[:, 0] == found.correspondence[:, 1]).all()
        assert found.distances == pytest.approx(0.0, abs=1e-3)


def test_pairs_of_the_default_are_one_to_one():
    clouds = [ready(by_hand(DEFAULT, count, count), DEFAULT) for count in (30, 50, 50, 80)]
    for first in clouds:
        for second in clouds:
            pairs = match(first, second, DEFAULT).correspondence
            assert len(pairs) == min(samples(first, DEFAULT), samples(second, DEFAULT))
            assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs)


def test_effective_pairs_are_one_to_one(prepared):
    parameters, clouds = prepared
    for first in clouds:
        for second in clouds:
            found = match(first, second, parameters)
            kept = found.correspondence[found.effective]
            assert len(np.unique(kept[:, 0])) == len(np.unique(kept[:, 1])) == len(kept)


@pytest.mark.parametrize("seed", range(4))
def test_a_cloud_turned_over_and_in_another_order_is_found(seed):
    rng = np.random.default_rng(seed)
    spectra = by_hand(DEFAULT, 70, 20 + seed)
    order = rng.permutation(70)
    signs = [rng.choice(np.float32([-1, 1]), size=DEFAULT.spectral.dimensions) for _ in spectra]
    other = tuple(
        Spectrum(one.name, one.eigenvalues, (one.coordinates * flip)[order])
        for one, flip in zip(spectra, signs, strict=True)
    )
    found = match(ready(spectra, DEFAULT), ready(other, DEFAULT), DEFAULT)
    assert found.cc == pytest.approx(1.0, abs=1e-6)
    assert found.ssd == pytest.approx(0.0, abs=1e-6)
    assert found.sim == 1.0
    assert (order[found.correspondence[:, 1]] == found.correspondence[:, 0]).all()


def test_part_of_a_cloud_is_found_in_the_whole():
    whole = by_hand(DEFAULT, 90, 31)
    kept = np.sort(np.random.default_rng(32).permutation(90)[:80])
    part = changed(whole, lambda points: np.ascontiguousarray(points[kept]))
    for first, second, inner, outer in ((part, whole, 0, 1), (whole, part, 1, 0)):
        found = match(ready(first, DEFAULT), ready(second, DEFAULT), DEFAULT)
        assert found.cc > 0.97
        assert (kept[found.correspondence[:, inner]] == found.correspondence[:, outer]).mean() > 0.95


def test_one_correspondence_has_to_suit_every_domain():
    """Two domains that agree each with a copy, but under different orders: no one order suits both."""
    spectra = by_hand(DEFAULT, 60, 5)
    order = np.random.default_rng(6).permutation(60)
    torn = (spectra[0], Spectrum(spectra[1].name, spectra[1].eigenvalues, spectra[1].coordinates[order]))
    assert match(ready(spectra, DEFAULT), ready(torn, DEFAULT), DEFAULT).cc < 0.9
    for one, other in zip(spectra, torn, strict=True):
        alone = [ready((spectrum,), DEFAULT) for spectrum in (one, other)]
        assert match(*alone, DEFAULT).cc == pytest.approx(1.0, abs=1e-6)


def test_a_prepared_shape_holds_spectra_and_splines(prepared):
    parameters, clouds = prepared
    for cloud in clouds:
        m = samples(cloud, parameters)
        if parameters.matching.pairs == "nearest":
            assert len(cloud.domains) == len(parameters.spectral.operators)
            assert cloud.nbytes == sum(one.points.nbytes + one.operators.nbytes for one in cloud.domains)
            for domain in cloud.domains:
                assert domain.points.shape == (m, parameters.spectral.dimensions)
                assert domain.operators.shape[1:] == (m, m)
            continue
        record = decoded(cloud)
        rows = min(m, parameters.matching.search_samples)
        b, k = len(parameters.spectral.operators), parameters.spectral.dimensions
        for place in range(b):
            own = record.points[:rows, place * k : place * k + parameters.matching.search_dimensions]
            assert np.array_equal(record.searched[place], own.T)
        stages = parameters.matching.search_dimensions - parameters.matching.first_dimensions + 1
        assert record.operators.shape == (b, stages, rows, rows)
        assert record.warp.shape == (b, m, m)
        assert sorted(record.members) == list(range(len(record.points)))
        assert record.offsets[0] == 0
        assert record.offsets[-1] == len(record.points)


def test_a_match_record_has_the_key_of_its_embedding():
    made = embedding(by_hand(DEFAULT, 30, 3))
    key = embedding_key(made)
    record = decoded(matcher_of(DEFAULT).prepare(made, key))
    assert record.key.tobytes() == np.frombuffer(key, ">u4").astype(np.uint32).tobytes()


def test_scores_of_many_are_those_of_each_match(prepared):
    parameters, clouds = prepared
    found = matcher_of(parameters).score(clouds[0], iter(clouds))
    for place, cloud in enumerate(clouds):
        one = match(clouds[0], cloud, parameters)
        assert (found.cc[place], found.ssd[place], found.sim[place]) == (one.cc, one.ssd, one.sim)


def test_the_key_is_of_the_coordinates_and_the_regions():
    one, other = (embedding(by_hand(DEFAULT, 30, seed)) for seed in (1, 2))
    named = replace(one, spectra=changed(one.spectra, np.copy), fingerprint="other")
    assert embedding_key(one) == embedding_key(named)
    assert embedding_key(one) != embedding_key(other)
    assert embedding_key(one) != embedding_key(replace(one, regions=one.regions % 20))
    assert len(embedding_key(one)) == 16
