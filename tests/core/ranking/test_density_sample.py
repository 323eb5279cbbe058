"""Densities in a sample, against all distances computed plainly."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from core.descriptors.facts import GLOBAL_DESCRIPTORS
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import view_distance
from core.gallery import CLASSES, make_shape
from core.pipeline import Pipeline
from core.ranking.local_density import (
    TYPICAL_SPECTRAL,
    TYPICAL_VIEW,
    densities_in,
    density_sample,
    neighbour_distances,
)


@cache
def shapes():
    pipeline = Pipeline()
    made = [make_shape(label, pose) for label in CLASSES[:6] for pose in range(2)]
    return [descriptors_of(pipeline.embed(mesh)) for mesh in made]


def plain(sample, shape):
    """Distances to all other shapes of the sample."""
    spectral = np.array(
        [np.linalg.norm((one.signature - shape.signature)[:-GLOBAL_DESCRIPTORS]) for one in sample]
    )
    views = view_distance(shape.arrays["views"], np.stack([one.arrays["views"] for one in sample]))
    itself = spectral == 0.0
    return np.where(itself, np.inf, spectral), np.where(itself, np.inf, views)


@pytest.mark.parametrize("count", [1, 3, 12])
def test_densities_are_those_of_all_distances(count):
    sample = shapes()[:count]
    found = densities_in(density_sample(sample), shapes())
    spectral, views = zip(*(plain(sample, shape) for shape in shapes()), strict=True)
    assert found.spectral == pytest.approx(
        neighbour_distances(np.array(spectral), TYPICAL_SPECTRAL), rel=1e-6
    )
    assert found.view == pytest.approx(neighbour_distances(np.array(views), TYPICAL_VIEW), rel=1e-12)


def test_copies_of_a_shape_are_no_neighbours_of_it():
    sample = density_sample(shapes())
    doubled = density_sample([*shapes(), shapes()[0], shapes()[0]])
    for one in (0, 5):
        before, after = (densities_in(each, [shapes()[one]]) for each in (sample, doubled))
        assert (before.spectral == after.spectral).all() == (one == 0)
        assert (before.view == after.view).all() == (one == 0)


def test_a_density_does_not_depend_on_the_other_shapes_asked_for():
    sample = density_sample(shapes()[2:])
    together = densities_in(sample, shapes())
    for place, shape in enumerate(shapes()):
        alone = densities_in(sample, [shape])
        assert (alone.spectral[0], alone.view[0]) == (together.spectral[place], together.view[place])


def test_without_a_sample_densities_are_typical():
    found = densities_in(density_sample([]), shapes()[:2])
    assert found.spectral.tolist() == [TYPICAL_SPECTRAL] * 2
    assert found.view.tolist() == [TYPICAL_VIEW] * 2


def test_the_nearest_views_of_many_shapes_are_mostly_found():
    """Noise makes a sample of 400; only view distances to the nearest by signature are computed."""
    rng = np.random.default_rng(0)
    sample = [noisy(shape, rng) for shape in shapes() for _ in range(33)]
    queries = [noisy(shape, rng) for shape in shapes()]
    found = densities_in(density_sample(sample), queries)
    truth = neighbour_distances(np.array([plain(sample, shape)[1] for shape in queries]), TYPICAL_VIEW)
    assert (found.view >= truth - 1e-12).all()
    assert found.view == pytest.approx(truth, rel=0.05)


def noisy(shape: ShapeDescriptors, rng: np.random.Generator) -> ShapeDescriptors:
    strength = 0.3 * rng.random()
    views = shape.arrays["views"] * np.exp(strength * rng.normal(size=shape.arrays["views"].shape))
    signature = shape.signature + np.float32(strength) * rng.standard_normal(
        shape.signature.shape, dtype=np.float32
    )
    arrays = {**shape.arrays, "views": np.minimum(np.rint(views), 255).astype(np.uint8)}
    return replace(shape, signature=signature, arrays=arrays)
