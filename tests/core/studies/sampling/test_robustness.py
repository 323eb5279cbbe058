"""Surfaces made ready for the trials, every way to sample them, and what noise and poses do."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from core.gallery import make_shape
from core.gallery.bodies import make_person
from core.gallery.solids import rotation
from core.gallery.surface import components, handles, is_closed_manifold
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.mesh.subdivision import refine
from core.studies.sampling import surface as sampling_surface
from core.studies.sampling.measures import coverage, distance_histogram, fit_residuals, total_variation
from core.studies.sampling.robustness import (
    REGIONS,
    noisy,
    pair_variations,
    regions_of,
    robust_histograms,
    size_of,
    unrest,
)
from core.studies.sampling.study import study_pose, study_shape, variations
from core.studies.sampling.surface import METHODS, OURS, SamplingMethod, Surface
from core.studies.sampling.trials import CURVE_TAUS, DEGREES, TAUS


@pytest.fixture(scope="module")
def surface():
    """A person of 904 vertices: distances between all pairs are what takes the time."""
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        yield Surface.of(make_shape("person", 2))


def make_small(patch):
    small = sampling_surface.STUDY_PARAMETERS.with_values(mesh={"refine_vertices": 0})
    patch.setattr(sampling_surface, "STUDY_PARAMETERS", small)


def names(methods):
    return [method.name for method in methods]


def test_a_large_mesh_is_simplified_first():
    large = refine(make_shape("cup", 0), 4500)
    assert len(large.vertices) > sampling_surface.STUDY_PARAMETERS.mesh.decimate_above
    wanted = sampling_surface.STUDY_PARAMETERS.mesh.decimate_to
    assert len(Surface.of(large).mesh.vertices) == pytest.approx(wanted, rel=0.1)


# Selections


def test_both_readings_of_each_selection_and_two_others():
    assert names(METHODS) == [
        "cut-printed", "cut", "draw-printed", "draw", "covering-printed", "covering", "poisson-disk",
        "farthest-point",
    ]  # fmt: skip
    assert all(method.weighted for method in OURS)


@pytest.mark.parametrize("method", METHODS, ids=names(METHODS))
@pytest.mark.parametrize("count", [1, 30, 300])
def test_a_method_takes_as_many_distinct_vertices_as_asked(surface, method, count):
    samples = surface.select(method, count)
    assert len(samples) == len(set(samples.tolist())) == count
    assert samples.min() >= 0
    assert samples.max() < len(surface.mesh.vertices)
    assert surface.select(method, count).tolist() == samples.tolist()


def test_the_printed_constants_leave_the_order_of_the_residuals(surface):
    residual = np.abs(fit_residuals(surface.mesh.vertices, 6))
    samples = surface.select(SamplingMethod("cut", printed=True), 100)
    assert residual[samples].min() >= np.delete(residual, samples).max() - 1e-12
    other = surface.select(SamplingMethod("cut"), 100)
    assert residual[other].min() < np.delete(residual, other).max()


def test_probabilities_of_a_draw_sum_to_its_size(surface):
    for printed in (True, False):
        probability = surface.probability(SamplingMethod("draw", printed), 100)
        assert probability.sum() == pytest.approx(100)
        assert probability.max() <= 1.0
    assert surface.probability(SamplingMethod("cut"), 100) is None


def test_selections_that_cover_leave_the_smallest_gaps(surface):
    gap = {
        method.name: coverage(surface.distances, surface.areas, surface.select(method, 60)).largest_gap
        for method in METHODS
    }
    # Greedy selection is within twice the best (Gonzalez 1985), so within twice any other.
    assert all(gap["farthest-point"] <= 2.0 * other for other in gap.values())
    assert max(gap["farthest-point"], gap["poisson-disk"], gap["covering"]) < min(gap["cut"], gap["draw"])


# Noise


@pytest.mark.parametrize("scale", [1.0, 250.0])
def test_the_size_is_the_diagonal_whatever_the_turn(scale):
    x, y, z = np.meshgrid([0.0, 3.0], [0.0, 2.0], [0.0, 1.0], indexing="ij")
    corners = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    turn = rotation("x", 35.0) @ rotation("z", 20.0)
    box = Mesh(scale * corners @ turn.T + 5.0, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    assert size_of(Surface.of(box)) == pytest.approx(scale * np.sqrt(14.0))


def test_noise_has_the_deviation_that_it_says(surface, monkeypatch):
    make_small(monkeypatch)
    found = noisy(surface, 0.0002).cleaned.vertices
    # So little that the nearest clean vertex is the one that was moved; cleaning orders them anew.
    _, home = cKDTree(surface.cleaned.vertices).query(found)
    assert sorted(home.tolist()) == list(range(len(found)))
    shift = found - surface.cleaned.vertices[home]
    assert shift.std(axis=0) == pytest.approx(np.full(3, 0.0002 * size_of(surface)), rel=0.1)
    assert np.abs(shift.mean(axis=0)).max() < 0.2 * shift.std()
    assert (noisy(surface, 0.0002).cleaned.vertices == found).all()
    assert (noisy(surface, 0.0002, seed=1).cleaned.vertices != found).any()


def test_noise_does_not_hang_on_the_order_of_the_vertices(surface, monkeypatch):
    make_small(monkeypatch)
    order = np.random.default_rng(7).permutation(len(surface.cleaned.vertices))
    place = np.argsort(order)
    shuffled = Surface.of(Mesh(surface.cleaned.vertices[order], place[surface.cleaned.faces]))
    away, _ = cKDTree(noisy(surface, 0.01).cleaned.vertices).query(noisy(shuffled, 0.01).cleaned.vertices)
    assert away.max() < 1e-9 * size_of(surface)


def test_regions_are_of_the_nearest_centre_and_none_is_empty(surface):
    regions = regions_of(surface)
    assert np.unique(regions).tolist() == list(range(REGIONS))
    # Two vertices of one region are no farther apart than by way of its centre.
    radius = (
        2.0
        * coverage(
            surface.distances, surface.areas, surface.select(SamplingMethod("farthest-point"), REGIONS)
        ).largest_gap
    )
    for region in range(0, REGIONS, 10):
        members = np.flatnonzero(regions == region)
        assert surface.distances[np.ix_(members, members)].max() <= radius + 1e-9


def test_without_noise_nothing_changes(surface):
    samples = {method: surface.select(method, 150) for method in METHODS}
    for row in unrest(surface, samples, surface, 0.0):
        assert row.histogram_change == 0.0
        assert row.overlap == pytest.approx(1.0)
        assert 0.0 < row.even_overlap < 1.0


def test_with_noise_preferred_places_are_kept(surface, monkeypatch):
    make_small(monkeypatch)
    method = SamplingMethod("cut", printed=True)
    samples = {method: surface.select(method, 150)}
    (little,) = unrest(surface, samples, noisy(surface, 0.0005), 0.0005)
    (much,) = unrest(surface, samples, noisy(surface, 0.05), 0.05)
    assert little.overlap > 0.9 > little.even_overlap
    assert little.overlap > much.overlap
    assert little.histogram_change < 0.05


# Poses


def test_poses_of_one_body_have_its_area_and_are_sound():
    bodies = {body: [make_person(body, pose) for pose in range(3)] for body in (0, 3)}
    areas = {
        body: [face_areas(mesh.vertices, mesh.faces).sum() for mesh in meshes]
        for body, meshes in bodies.items()
    }
    for body, meshes in bodies.items():
        # What bends at the joints changes the area by less than one per cent; another body by more.
        assert np.ptp(areas[body]) < 0.015 * np.mean(areas[body])
        for mesh in meshes:
            assert is_closed_manifold(mesh.faces)
            assert (components(mesh.faces), handles(mesh.faces)) == (1, 0)
        for one, other in pairwise(meshes):
            assert np.abs(np.ptp(one.vertices, axis=0) - np.ptp(other.vertices, axis=0)).max() > 0.05
    assert abs(np.mean(areas[0]) - np.mean(areas[3])) > 0.03 * np.mean(areas[0])
    assert (make_person(0, 1).vertices == bodies[0][1].vertices).all()


def test_variations_of_pairs():
    first = {"cut": np.array([1.0, 0.0])}
    second = {"cut": np.array([0.7, 0.3])}
    third = {"cut": np.array([0.5, 0.5])}
    assert pair_variations([first, second, third], "cut").tolist() == pytest.approx([0.3, 0.5, 0.2])
    assert len(pair_variations([first], "cut")) == 0


# The whole of it


def test_a_study_holds_every_trial_of_every_method(surface, monkeypatch):
    make_small(monkeypatch)
    found = study_shape("person", surface)
    assert (found.name, found.vertices) == ("person", len(surface.mesh.vertices))
    assert len(found.fit_errors) == len(DEGREES)
    assert sorted(found.fit_errors, reverse=True) == list(found.fit_errors)
    whole = np.array(found.surface_histogram)
    assert whole == pytest.approx(distance_histogram(surface.distances))
    for method, steady, quality in zip(METHODS, found.steadiness, found.quality, strict=True):
        assert steady.method == quality.method == method.name
        assert np.sum(steady.histograms, axis=1) == pytest.approx(np.ones(len(TAUS)))
        away = [total_variation(np.array(one), whole) for one in steady.histograms]
        assert steady.from_surface == pytest.approx(np.mean(away))
        assert sum(quality.histogram) == pytest.approx(1.0)
        assert quality.samples == round(0.1 * found.vertices)
        assert quality.fit_error >= found.fit_errors[-1] - 1e-12
        assert len(quality.rebuilt_errors) == len(CURVE_TAUS)
    assert [row.method for row in found.noise] == 3 * names(METHODS)
    pose = study_pose("again", surface)
    assert pose.robust_histograms == found.robust_histograms
    assert {
        name: tuple(h.tolist()) for name, h in robust_histograms(surface).items()
    } == pose.robust_histograms
    assert variations([found, pose], "cut").tolist() == [0.0]
