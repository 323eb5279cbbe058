"""On real meshes: pose, place, size and order of the file change no answer."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.datasets import read_collection
from tests.core.shapes import SAME_SHAPE
from tests.soak.collections.folders import every_collection, read

pytestmark = pytest.mark.collections

PIPELINE = Pipeline(DEFAULT)
QUERIES, STORED = 10, 40
DRIFT = 0.01
# Between polygon soups that are not alike, several maps fit about as well, and rounding chooses among them.
SOUPS, DRIFT_OF_SOUPS = {"webmodels"}, 0.1


@cache
def selection(folder: Path) -> list[Path]:
    """Some files of a collection, drawn with a seed."""
    files = sorted(path for path, _ in read_collection(folder))
    return [files[i] for i in np.random.default_rng(2).permutation(len(files))[:STORED]]


@cache
def stored(folder: Path):
    return [PIPELINE.embed(read(path)) for path in selection(folder)]


@every_collection
@pytest.mark.parametrize("place", range(QUERIES))
def test_a_shape_given_otherwise_has_the_same_neighbours(folder, place):
    mesh, others = read(selection(folder)[place]), stored(folder)
    expected = PIPELINE.score(others[place], others).cc
    drift, first = (DRIFT_OF_SOUPS, 1) if folder.name in SOUPS else (DRIFT, 4)
    neighbours = np.argsort(-expected, kind="stable")[:first].tolist()
    for name, change in SAME_SHAPE.items():
        cc = PIPELINE.score(PIPELINE.embed(change(mesh)), others).cc
        assert cc[place] >= 0.999, name
        assert np.abs(cc - expected).max() <= drift, name
        assert np.argsort(-cc, kind="stable")[:first].tolist() == neighbours, name
    assert neighbours[0] == place


@every_collection
@pytest.mark.parametrize("place", range(QUERIES))
def test_scores_are_the_same_both_ways_and_perfect_with_itself(folder, place):
    others = stored(folder)
    there = PIPELINE.score(others[place], others)
    back = [PIPELINE.score(other, [others[place]]) for other in others]
    for name in ("cc", "ssd", "sim"):
        expected = [getattr(scores, name)[0] for scores in back]
        np.testing.assert_allclose(getattr(there, name), expected, rtol=0, atol=1e-9)
    assert there.cc[place] == pytest.approx(1.0, abs=1e-6)
    assert there.ssd[place] == pytest.approx(0.0, abs=1e-6)
    assert there.sim[place] == pytest.approx(1.0, abs=1e-6)
