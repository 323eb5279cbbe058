"""The two experts: what each one reads, what order they give, and what they leave to the other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from core.descriptors.registry import DESCRIPTORS
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.class_probability import (
    BONUS,
    FINE,
    FINEST,
    NETWORK_FEATURES,
    PART_FEATURES,
    Calibration,
    features,
    isometry_bonus,
    part_features,
    pooled_log_odds,
    pooled_probability,
)
from core.ranking.differences import PairDifferences
from core.ranking.local_density import TYPICAL_NETWORK, TYPICAL_SPECTRAL, TYPICAL_VIEW
from tests.gallery import make_shape

DIFFERENCES = ("global_distance", "spin_images", "views")


def differences(count: int = 1, **given: object) -> PairDifferences:
    """Pairs of closed surfaces that differ as two of one class do, but for what is given."""
    usual = {
        "cc": 0.99,
        "sim": 0.6,
        "spectral": 0.1,
        "global_distance": 0.3,
        "spin_images": 1.5,
        "part": False,
        "part_distance": 1.5,
        "views": 0.7,
        "eigenvalues": 0.1,
        "network_views": 0.4,
        "reliability": 1.0,
        "spectral_density": 0.14,
        "view_density": 0.76,
        "network_density": 0.4,
    }
    values: dict[str, Any] = {name: np.full(count, value) for name, value in usual.items()} | given
    distances = {name: values.pop(name) for name in DESCRIPTORS}
    return PairDifferences(**values, distances=distances)


def plain_features(pair: PairDifferences, *, network: bool = False) -> list[float]:
    """`features` of one pair, a number at a time."""
    x, r = np.sqrt(pair.distances["eigenvalues"][0] * pair.spectral[0]), pair.reliability[0]
    w = 1 - r * 0.05**6 / (x**6 + 0.05**6)
    logs = [
        np.log(w * (1 - pair.cc[0]) + 0.01),
        np.log(w * (1 - pair.sim[0]) + 0.05),
        np.log(w * pair.global_distance[0] + 0.1),
        np.log(w * pair.distances["spin_images"][0] + 0.05),
        np.log(w * pair.distances["views"][0] + 0.05),
    ]
    soup = [(1 - r) * value for value in logs]
    dense = w * np.log(max(pair.view_density[0], 0.6) / TYPICAL_VIEW)
    near = w * np.log((max(pair.spectral_density[0], 0.02) + 0.03) / (TYPICAL_SPECTRAL + 0.03))
    told = [*logs, 1 - r, *soup, r * dense, (1 - r) * dense, r * near]
    if network:
        seen = np.log(w * pair.distances["network_views"][0] + 0.05)
        among = w * np.log(max(pair.network_density[0], 0.05) / TYPICAL_NETWORK)
        told += [seen, (1 - r) * seen, among, (1 - r) * among]
    return told


@pytest.mark.parametrize("reliability", [0.01, 0.4, 1.0])
@pytest.mark.parametrize("eigenvalues", [0.0, 0.05, 0.4])
def test_the_features_are_those_of_the_formula(reliability: float, eigenvalues: float) -> None:
    pair = differences(reliability=np.array([reliability]), eigenvalues=np.array([eigenvalues]))
    assert features(pair)[0] == pytest.approx(plain_features(pair))
    assert features(pair, network=True)[0] == pytest.approx(plain_features(pair, network=True))
    assert part_features(pair).shape == (1, PART_FEATURES)
    assert part_features(pair, network=True).shape == (1, PART_FEATURES + NETWORK_FEATURES)


def test_soups_are_told_by_views_and_not_by_spectra() -> None:
    soup = np.full(20, 0.02)
    views = np.linspace(0.3, 1.3, 20)
    assert (np.diff(pooled_probability(differences(20, reliability=soup, views=views))) < 0.0).all()
    near, far = (
        pooled_log_odds(differences(reliability=soup[:1], spectral=np.array([value])))[0]
        for value in (0.05, 0.5)
    )
    assert abs(near - far) < 0.5


def test_poses_of_one_body_are_told_by_spectra_and_not_by_views() -> None:
    spectral = np.geomspace(1e-4, 0.02, 20)
    order = pooled_log_odds(
        differences(20, spectral=spectral, eigenvalues=spectral, views=np.linspace(1.2, 0.4, 20))
    )
    assert (np.diff(order) < 0.0).all()
    far = pooled_log_odds(differences(2, spectral=np.full(2, 0.3), views=np.array([0.4, 1.2])))
    close = np.full(2, 0.005)
    near = pooled_log_odds(differences(2, spectral=close, eigenvalues=close, views=np.array([0.4, 1.2])))
    assert near[0] - near[1] < 0.1 * (far[0] - far[1])


def test_log_odds_order_pairs_of_equal_probability() -> None:
    tiny = np.array([1e-6, 2e-6])
    pairs = differences(2, spectral=tiny, eigenvalues=tiny, cc=np.ones(2), sim=np.ones(2))
    odds = pooled_log_odds(pairs)
    assert odds[0] > odds[1]
    assert pooled_probability(pairs) == pytest.approx(1.0 / (1.0 + np.exp(-odds)))


def test_the_eigenvalues_of_signatures_stand_for_many_that_lack() -> None:
    distances, lacking = np.array([0.004, 0.06]), np.full(2, np.nan)
    known = differences(2, spectral=distances, eigenvalues=distances)
    unknown = differences(2, spectral=distances, eigenvalues=lacking)
    assert isometry_bonus(unknown) == pytest.approx(isometry_bonus(known))
    assert features(unknown) == pytest.approx(features(known))


def test_a_pair_without_views_of_a_network_has_models_of_its_own() -> None:
    """A lacking view says nothing for or against a pair."""
    lacking = differences(network_views=np.array([np.nan]))
    assert np.isfinite(pooled_log_odds(lacking)).all()
    near, usual, far = (
        pooled_log_odds(differences(network_views=np.array([distance])))[0] for distance in (0.1, 0.4, 0.9)
    )
    assert near > usual > far
    assert near > pooled_log_odds(lacking)[0] > far


def test_the_offset_is_bounded_and_vanishes() -> None:
    found = isometry_bonus(
        differences(
            4,
            spectral=np.array([0.0, 0.05, 10.0, 0.0]),
            eigenvalues=np.array([0.0, 0.05, 10.0, 0.0]),
            reliability=np.array([1, 1, 1, 0.0]),
        )
    )
    assert found[0] == pytest.approx(BONUS * np.log(FINE / FINEST))
    assert (np.diff(found[:3]) < 0.0).all()
    assert found[2] < 0.01
    assert found[3] == 0.0


@pytest.mark.parametrize("part", [False, True])
@pytest.mark.parametrize("name", DIFFERENCES)
def test_a_hub_needs_more_and_differences_count(part: bool, name: str) -> None:
    pairs = differences(2, part=np.full(2, part), reliability=np.full(2, 0.5))
    dense, sparse = pooled_log_odds(replace(pairs, view_density=np.array([0.65, 0.9])))
    assert dense < sparse - 1.0
    values = {"global_distance": pairs.global_distance, **pairs.distances}
    values[name] = 2.0 * values[name]
    larger = replace(
        pairs,
        global_distance=values.pop("global_distance"),
        distances=values,
        part_distance=2.0 * pairs.part_distance,
    )
    assert (pooled_log_odds(larger) < pooled_log_odds(pairs)).all()


def test_an_incomplete_shape_is_told_by_its_part_distance() -> None:
    distances = np.geomspace(0.1, 5.0, 20)
    pairs = differences(20, part=np.ones(20, dtype=bool), part_distance=distances)
    assert (np.diff(pooled_probability(pairs)) < 0.0).all()
    assert np.ptp(pooled_probability(replace(pairs, part=np.zeros(20, dtype=bool)))) == 0.0


def test_copies_of_a_shape_do_not_make_its_poses_unlikely() -> None:
    """Among many copies of a shape, its seventh neighbour is a copy."""
    pose = differences(
        eigenvalues=np.array([0.02]), view_density=np.array([1e-4]), spectral_density=np.array([1e-4])
    )
    assert pooled_probability(pose)[0] > 0.9
    assert features(pose)[0] == pytest.approx(plain_features(pose))


@pytest.fixture(scope="module")
def embedded():
    pipeline = Pipeline(DEFAULT)
    shapes = [
        make_shape(label, pose) for label, pose in (("cup", 0), ("cup", 1), ("octopus", 0), ("snake", 2))
    ]
    return pipeline, [pipeline.embed(mesh) for mesh in shapes]


def combined(pipeline, query, candidates):
    return pipeline.combined(query, candidates, pipeline.score(query, candidates))


def test_a_model_of_known_numbers():
    model = Calibration(intercept=np.log(3.0), slopes=(-1.0, -2.0))
    logs = np.log([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]])
    assert model.class_probability(logs) == pytest.approx([3.0 / 4.0, 1.0 / 2.0, 1.0 / 4.0])


def test_a_shape_against_itself_is_of_its_class(embedded):
    pipeline, embeddings = embedded
    for embedding in embeddings:
        (itself,) = combined(pipeline, embedding, [embedding])
        others = combined(pipeline, embedding, [other for other in embeddings if other is not embedding])
        assert itself > 0.9
        assert (others < itself).all()


def test_both_ways_to_the_last_bit(embedded):
    pipeline, embeddings = embedded
    rows = np.stack([combined(pipeline, embedding, embeddings) for embedding in embeddings])
    assert rows.shape == (4, 4)
    assert rows.dtype == np.float64
    assert (rows == rows.T).all()
    assert ((rows >= 0.0) & (rows <= 1.0)).all()


def test_poses_of_one_class_are_likelier_than_two_classes(embedded):
    pipeline, (cup, other_cup, octopus, snake) = embedded
    alike, *different = combined(pipeline, cup, [other_cup, octopus, snake])
    assert alike > 0.2
    assert max(different) < 0.001
    assert alike > 1000.0 * max(different)
