"""`combined`: a chance, the same both ways, falling with everything that differs."""

import numpy as np
import pytest

from core.descriptors.descriptor_distance import DescriptorDistance
from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT
from core.gallery import make_shape
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.ranking.class_probability import Calibration, class_probability, features, signature_features

CC = np.concatenate([[-1.0], np.linspace(0.0, 0.99, 20), [0.999, 1.0]])
SIM = np.linspace(0.0, 1.0, 8)
DISTANCES = np.concatenate([[0.0], np.geomspace(1e-3, 30.0, 20)])


@pytest.fixture(scope="module")
def embedded():
    pipeline = Pipeline(DEFAULT)
    shapes = [
        make_shape(label, pose) for label, pose in (("cup", 0), ("cup", 1), ("octopus", 0), ("snake", 2))
    ]
    return pipeline, [pipeline.embed(mesh) for mesh in shapes]


def combined(pipeline, query, candidates):
    return pipeline.combined_with(query, candidates, pipeline.score(query, candidates))


def test_a_model_of_known_numbers():
    model = Calibration(intercept=np.log(3.0), slopes=(-1.0, -2.0))
    logs = np.log([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]])
    assert model.class_probability(logs) == pytest.approx([3.0 / 4.0, 1.0 / 2.0, 1.0 / 4.0])


def descriptor_distance(distance, *, part):
    return DescriptorDistance(distance, np.full(distance.shape, part))


MODELS = {
    "complete": lambda whole, distance: class_probability(whole, descriptor_distance(distance, part=False)),
    "incomplete": lambda whole, distance: class_probability(whole, descriptor_distance(distance, part=True)),
    "unknown": lambda whole, _: class_probability(whole, None),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("place", range(5), ids=["cc", "sim", "spectral", "form", "patches"])
def test_a_larger_difference_is_never_more_probable(model, place):
    grids = [1.0 - CC, 1.0 - SIM, DISTANCES, DISTANCES, DISTANCES]
    order = np.argsort(grids[place])
    *grid, distance = np.meshgrid(CC, SIM, DISTANCES, DISTANCES, DISTANCES[::4], indexing="ij")
    if place == 4:
        *grid, distance = np.meshgrid(CC, SIM, DISTANCES[::4], DISTANCES[::4], DISTANCES, indexing="ij")
    probabilities = MODELS[model](features(*grid), distance)
    assert ((probabilities >= 0.0) & (probabilities <= 1.0)).all()
    steps = np.diff(np.take(probabilities, order, axis=place), axis=place)
    if (model, place) in {("incomplete", 3), ("unknown", 4)}:
        assert (steps == 0.0).all()
    else:
        assert (steps <= 0.0).all()
        assert steps.min() < (-0.0005 if (model, place) == ("incomplete", 1) else -0.01)


def test_a_higher_cc_is_always_likelier_where_the_spectra_differ():
    cc = np.sort(CC)
    for spectral in (0.01, 0.1, 1.0):
        whole = features(cc, *(np.full_like(cc, value) for value in (0.5, spectral, 0.5)))
        for model in MODELS.values():
            assert (np.diff(model(whole, np.full_like(cc, 1.0))) > 0.0).all()


def test_where_the_spectra_are_one_neither_cc_nor_form_counts():
    rows = features(np.array([0.5, 0.99]), np.array([0.1, 1.0]), np.zeros(2), np.array([0.0, 3.0]))
    assert (rows[0] == rows[1]).all()


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


def test_the_others_compared_change_nothing(embedded):
    pipeline, embeddings = embedded
    together = combined(pipeline, embeddings[0], embeddings)
    for embedding, likelihood in zip(embeddings, together, strict=True):
        assert combined(pipeline, embeddings[0], [embedding])[0] == likelihood


def test_poses_of_one_class_are_likelier_than_two_classes(embedded):
    pipeline, (cup, other_cup, octopus, snake) = embedded
    alike, *different = combined(pipeline, cup, [other_cup, octopus, snake])
    assert alike > 0.2
    assert max(different) < 0.001
    assert alike > 1000.0 * max(different)


def test_no_candidates():
    empty = Pipeline(DEFAULT).combined(
        np.empty(0), np.empty(0), np.ones(33, np.float32), np.empty((0, 33), np.float32)
    )
    assert empty.shape == (0,)


def test_the_parts_of_a_signature():
    rng = np.random.default_rng(0)
    query, other = rng.normal(size=(2, 5 + GLOBAL_DESCRIPTORS)).astype(np.float32)
    steps = other.astype(np.float64) - query
    spectral, form = np.linalg.norm(steps[:5]), np.linalg.norm(steps[5:]) / GLOBAL_WEIGHT
    scores = np.array([0.7]), np.array([0.4])
    expected = features(*scores, np.array([spectral]), np.array([form]))
    found = signature_features(*scores, query, other[None], global_descriptors=True)
    np.testing.assert_allclose(found, expected)
    whole = features(*scores, np.array([np.linalg.norm(steps)]), np.array([0.0]))
    np.testing.assert_allclose(
        signature_features(*scores, query, other[None], global_descriptors=False), whole
    )


@pytest.mark.parametrize("parameters", [PAPER, DEFAULT.with_values(form=False, affinity_values=7)])
def test_a_setting_without_form_has_an_order_too(parameters):
    pipeline = Pipeline(parameters)
    first, second = (pipeline.embed(make_shape(label, 0)) for label in ("cup", "snake"))
    assert len(first.signature) == parameters.spectral.affinity_values + parameters.spectral.laplacian_values
    rows = pipeline.features(
        np.full(2, 0.9), np.full(2, 0.5), first.signature, np.stack([first.signature, second.signature])
    )
    assert rows[0, 0] < rows[1, 0]
    assert rows[0, 1] == rows[1, 1]
