"""Distances to the seventh neighbour, against sorting, and in a sample, against all distances."""

from dataclasses import astuple, replace
from functools import cache

import numpy as np
import pytest

from core.descriptors.facts import GLOBAL_DESCRIPTORS
from core.descriptors.network_views import network_view_distance
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import VIEW_BYTES, VIEW_SCALE, view_distance, view_signature
from core.embedding import Scores
from core.gallery import CLASSES
from core.pipeline import Pipeline
from core.ranking.differences import differences_of
from core.ranking.local_density import (
    ENOUGH,
    NEIGHBOUR,
    TYPICAL_NETWORK,
    TYPICAL_SPECTRAL,
    TYPICAL_VIEW,
    densities_in,
    density_sample,
    estimated_densities,
    lifted,
    neighbour_distances,
)
from tests.core.ranking.test_kinds import POSES, posed_bodies
from tests.gallery import make_shape

TYPICAL = 0.3


def test_the_seventh_of_many_is_that_of_a_sort() -> None:
    distances = np.random.default_rng(0).random((5, ENOUGH + 20))
    distances[2, :4] = np.inf
    found = neighbour_distances(distances, TYPICAL)
    assert found == pytest.approx(np.sort(distances, axis=1)[:, NEIGHBOUR - 1])


def test_few_shapes_tell_little() -> None:
    assert neighbour_distances(np.empty((2, 0)), TYPICAL).tolist() == [TYPICAL, TYPICAL]
    assert neighbour_distances(np.full((1, 3), np.inf), TYPICAL).tolist() == [TYPICAL]
    few = neighbour_distances(np.array([[0.1, 0.2, np.inf]]), TYPICAL)
    assert few == pytest.approx([0.2 ** (2 / ENOUGH) * TYPICAL ** (1 - 2 / ENOUGH)])
    half = neighbour_distances(np.full((1, ENOUGH // 2), 0.1), TYPICAL)
    assert half == pytest.approx([np.sqrt(0.1 * TYPICAL)])


def test_copies_of_a_shape_give_a_small_positive_density() -> None:
    found = neighbour_distances(np.zeros((1, 2 * ENOUGH)), TYPICAL)
    assert 0.0 < found[0] < 1e-3


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
    seen = network_view_distance(
        shape.arrays["network_views"], [one.arrays["network_views"] for one in sample]
    )
    return tuple(np.where(itself, np.inf, distances) for distances in (spectral, views, seen))


@pytest.mark.parametrize("count", [1, 3, 12])
def test_densities_are_those_of_all_distances(count):
    sample = shapes()[:count]
    found = densities_in(density_sample(sample), shapes())
    spectral, views, seen = zip(*(plain(sample, shape) for shape in shapes()), strict=True)
    assert found.spectral == pytest.approx(
        neighbour_distances(np.array(spectral), TYPICAL_SPECTRAL), rel=1e-6
    )
    assert found.view == pytest.approx(neighbour_distances(np.array(views), TYPICAL_VIEW), rel=1e-12)
    assert found.network == pytest.approx(neighbour_distances(np.array(seen), TYPICAL_NETWORK), rel=1e-12)


def test_a_shape_without_views_of_the_network_has_a_typical_density_of_them():
    bare = [replace(shape, arrays={"views": shape.arrays["views"]}) for shape in shapes()[:2]]
    sample = density_sample([*bare, *shapes()[2:]])
    assert densities_in(sample, bare).network.tolist() == [TYPICAL_NETWORK] * 2
    seen = [plain(shapes()[2:], shape)[2] for shape in shapes()[2:]]
    expected = neighbour_distances(np.array(seen), TYPICAL_NETWORK)
    assert densities_in(sample, shapes()[2:]).network == pytest.approx(expected, rel=1e-12)
    assert densities_in(density_sample(bare), shapes()).network.tolist() == [TYPICAL_NETWORK] * len(shapes())


def test_copies_of_a_shape_are_no_neighbours_of_it():
    sample = density_sample(shapes())
    doubled = density_sample([*shapes(), shapes()[0], shapes()[0]])
    for one in (0, 5):
        before, after = (densities_in(each, [shapes()[one]]) for each in (sample, doubled))
        assert (before.spectral == after.spectral).all() == (one == 0)
        assert (before.view == after.view).all() == (one == 0)
        assert (before.network == after.network).all() == (one == 0)


def test_a_density_does_not_depend_on_the_other_shapes_asked_for():
    sample = density_sample(shapes()[2:])
    together = densities_in(sample, shapes())
    for place, shape in enumerate(shapes()):
        alone = densities_in(sample, [shape])
        *distances, kinds = astuple(alone)
        *others, all_kinds = astuple(together)
        for found, those in zip((*distances, *kinds), (*others, *all_kinds), strict=True):
            assert (found[0] == those[place]).all()


def test_poses_of_a_kind_are_nearer_by_its_metric_and_shapes_without_eigenvalues_have_none():
    made = shapes()[0]
    rng = np.random.default_rng(0)
    sample = [
        replace(
            made,
            arrays=made.arrays
            | {
                "eigenvalues": row.astype(np.float16),
                "views": rng.integers(256, size=VIEW_BYTES, dtype=np.uint8),
            },
        )
        for row in posed_bodies(0)
    ]
    bare = replace(made, arrays={name: made.arrays[name] for name in ("views", "spin_images")})
    around = density_sample(sample)
    own, densities = densities_in(around, sample[:1]), densities_in(around, [*sample, bare])
    scores = Scores(*np.zeros((3, len(sample) + 1)))
    found = differences_of(sample[0], [*sample, bare], scores, own, densities).distances["eigenvalues"]
    plain = differences_of(sample[0], [*sample, bare], scores).distances["eigenvalues"]
    metric = own.kinds.distances(densities.kinds)
    assert np.isnan(found[-1])
    assert np.isinf(metric[-1])
    assert found[:-1].tolist() == np.minimum(plain, metric)[:-1].tolist()
    assert (found < 0.7 * plain)[1:POSES].all()


def short(shapes):
    """Signatures and view signatures."""
    views = [view_signature(shape.arrays["views"]) for shape in shapes]
    return np.stack([shape.signature for shape in shapes]), np.stack(views)


@pytest.mark.parametrize("count", [1, 3, 12])
def test_estimates_are_exact_by_eigenvalues_and_follow_view_signatures(count):
    sample = shapes()[:count]
    signatures, views = short(shapes())
    found = estimated_densities(density_sample(sample), signatures, views)
    exact = densities_in(density_sample(sample), shapes())
    assert found.spectral.tolist() == exact.spectral.tolist()
    steps = views[:, None].astype(float) - views[:count]
    distances = VIEW_SCALE * np.abs(steps).sum(axis=2)
    distances[np.arange(count), np.arange(count)] = np.inf
    assert found.view == pytest.approx(neighbour_distances(distances, TYPICAL_VIEW), rel=1e-12)
    assert found.view == pytest.approx(exact.view, rel=0.3)
    assert found.network.tolist() == [TYPICAL_NETWORK] * len(shapes())
    part = found.only(np.array([4, 2]))
    assert part.view.tolist() == found.view[[4, 2]].tolist()
    assert np.isinf(part.kinds.distances(part.kinds)).all()


def test_without_a_sample_estimates_are_typical():
    found = estimated_densities(density_sample([]), *short(shapes()[:2]))
    assert found.spectral.tolist() == [TYPICAL_SPECTRAL] * 2
    assert found.view.tolist() == [TYPICAL_VIEW] * 2


def test_without_a_sample_densities_are_typical():
    found = densities_in(density_sample([]), shapes()[:2])
    assert found.spectral.tolist() == [TYPICAL_SPECTRAL] * 2
    assert found.view.tolist() == [TYPICAL_VIEW] * 2
    assert np.isinf(found.kinds.distances(found.kinds)).all()


def test_where_most_shapes_look_alike_the_median_density_is_typical():
    rng = np.random.default_rng(0)
    alike = [noisy(shape, rng) for shape in shapes()[:3] for _ in range(40)]
    found = densities_in(density_sample(alike), alike)
    assert np.median(found.view) == pytest.approx(TYPICAL_VIEW, rel=0.1)
    assert np.median(found.network) == pytest.approx(TYPICAL_NETWORK, rel=0.1)
    # Shapes without views of the network do not count.
    bare = [replace(one, arrays={"views": one.arrays["views"]}) for one in alike]
    around = density_sample([*alike, *bare])
    assert around.network_median == pytest.approx(density_sample(alike).network_median, rel=0.2)
    assert density_sample(bare).network_median == TYPICAL_NETWORK


def test_no_density_is_lifted_above_the_typical_one():
    densities = np.array([0.01, 0.1, 0.2, 0.5, 2.0])
    assert lifted(densities, 0.1, 0.5) == pytest.approx([0.05, 0.5, 0.5, 0.5, 2.0])
    assert (lifted(densities, 1.0, 0.5) == densities).all()


def test_collections_of_unlike_shapes_keep_their_densities():
    around = density_sample(shapes())
    assert around.view_median >= TYPICAL_VIEW
    assert around.network_median >= TYPICAL_NETWORK


def test_the_nearest_views_of_many_shapes_are_mostly_found():
    """Noise makes a sample of 400; only distances to the nearest by signature or mean view are computed."""
    rng = np.random.default_rng(0)
    sample = [noisy(shape, rng) for shape in shapes() for _ in range(33)]
    queries = [noisy(shape, rng) for shape in shapes()]
    around = density_sample(sample)
    found = densities_in(around, queries)
    _, views, seen = zip(*(plain(sample, shape) for shape in queries), strict=True)
    for density, distances, typical, median in (
        (found.view, views, TYPICAL_VIEW, around.view_median),
        (found.network, seen, TYPICAL_NETWORK, around.network_median),
    ):
        truth = lifted(neighbour_distances(np.array(distances), typical), median, typical)
        assert (density >= truth - 1e-12).all()
        assert density == pytest.approx(truth, rel=0.05)


def noisy(shape: ShapeDescriptors, rng: np.random.Generator) -> ShapeDescriptors:
    strength = 0.3 * rng.random()
    views = shape.arrays["views"] * np.exp(strength * rng.normal(size=shape.arrays["views"].shape))
    signature = shape.signature + np.float32(strength) * rng.standard_normal(
        shape.signature.shape, dtype=np.float32
    )
    seen = shape.arrays["network_views"] + 80 * strength * rng.normal(
        size=shape.arrays["network_views"].shape
    )
    arrays = {
        "views": np.minimum(np.rint(views), 255).astype(np.uint8),
        "network_views": np.clip(np.rint(seen), -127, 127).astype(np.int8),
    }
    return replace(shape, signature=signature, arrays=arrays)
