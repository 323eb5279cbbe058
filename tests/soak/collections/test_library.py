"""On real meshes: all are embedded, and pose, position, size and order of the file change no answer."""

from functools import cache

import numpy as np
import pytest

from core.descriptors.facts import GLOBAL_DESCRIPTORS
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.core.shapes import SAME_SHAPE
from tests.soak.collections.folders import read, sample

PIPELINE = Pipeline(DEFAULT)
STORED, QUERIES = 32, 3
DRIFT = 0.01
# Between polygon soups that are not alike, several maps fit about as well, and rounding chooses among them.
SOUPS, DRIFT_OF_SOUPS = {"webmodels"}, 0.1

every_collection = pytest.mark.parametrize("name", ["psb", "shrec11", "tosca", "webmodels"])


@cache
def embeddings(name):
    return [PIPELINE.embed(read(path)) for path, _ in sample(name, STORED)]


@every_collection
def test_every_file_is_read_and_embedded(name):
    for path, _ in sample(name):
        embedding = PIPELINE.embed(read(path))
        assert len(embedding.positions) == DEFAULT.sampling.samples, path.name
        length = DEFAULT.spectral.affinity_values + DEFAULT.spectral.laplacian_values + GLOBAL_DESCRIPTORS
        assert len(embedding.signature) == length, path.name
        for array in (embedding.signature, *(spectrum.coordinates for spectrum in embedding.spectra)):
            assert np.isfinite(array).all(), path.name


@every_collection
@pytest.mark.parametrize("query", range(QUERIES))
def test_a_shape_given_otherwise_has_the_same_neighbours(name, query):
    mesh, stored = read(sample(name, STORED)[query][0]), embeddings(name)
    expected = PIPELINE.score(stored[query], stored).cc
    drift, first = (DRIFT_OF_SOUPS, 1) if name in SOUPS else (DRIFT, 4)
    neighbours = np.argsort(-expected, kind="stable")[:first].tolist()
    for label, change in SAME_SHAPE.items():
        cc = PIPELINE.score(PIPELINE.embed(change(mesh)), stored).cc
        assert cc[query] >= 0.999, label
        assert np.abs(cc - expected).max() <= drift, label
        assert np.argsort(-cc, kind="stable")[:first].tolist() == neighbours, label
    assert neighbours[0] == query


@every_collection
@pytest.mark.parametrize("query", range(QUERIES))
def test_scores_are_the_same_both_ways_and_perfect_with_itself(name, query):
    stored = embeddings(name)
    forth = PIPELINE.score(stored[query], stored)
    back = [PIPELINE.score(embedding, [stored[query]]) for embedding in stored]
    for measure in ("cc", "ssd", "sim"):
        expected = [getattr(scores, measure)[0] for scores in back]
        np.testing.assert_allclose(getattr(forth, measure), expected, rtol=0, atol=1e-9)
    assert forth.cc[query] == pytest.approx(1.0, abs=1e-6)
    assert forth.ssd[query] == pytest.approx(0.0, abs=1e-6)
    assert forth.sim[query] == pytest.approx(1.0, abs=1e-6)
