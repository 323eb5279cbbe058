"""Open rims against surfaces whose rims are known."""

import numpy as np
import pytest

from core.descriptors.facts import boundary_ratio
from core.descriptors.partial import INCOMPLETE
from core.evaluation.perturbation import cut_part, remove_discs
from core.gallery import make_shape
from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.studies.perturbation import make_soup


def open_share(mesh: Mesh) -> float:
    mesh = clean(mesh).mesh
    sides = half_edges(mesh.faces)
    area = face_areas(mesh.vertices, mesh.faces).sum()
    return boundary_ratio(mesh, sides, float(area))


def tube(around: int, height: float) -> Mesh:
    """A cylinder of radius 1 without its ends."""
    angle = 2.0 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(around)], axis=1)
    i = np.arange(around)
    j = (i + 1) % around
    faces = np.concatenate([np.stack([i, j, around + i], 1), np.stack([j, around + j, around + i], 1)])
    return Mesh(np.concatenate([ring, ring + np.array([0.0, 0.0, height])]), faces)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e6])
def test_the_two_rims_of_a_tube_bound_its_two_ends(scale: float) -> None:
    mesh = tube(200, 4.0)
    assert open_share(Mesh(scale * mesh.vertices, mesh.faces)) == pytest.approx(2.0 / (2.0 * 4.0), rel=1e-3)


def test_a_closed_surface_has_none_and_a_sheet_no_more_than_its_area() -> None:
    assert open_share(make_shape("cup", 0)) == 0.0
    triangle = Mesh(np.array([[0, 0, 0], [2, 0, 0], [1, np.sqrt(3), 0]]), np.array([[0, 1, 2]]))
    assert open_share(triangle) == 1.0


@pytest.mark.parametrize(("smaller", "counts"), [(4.0, False), (0.5, True)])
def test_the_rims_of_a_model_of_several_pieces_do_not_count(smaller: float, counts: bool) -> None:
    large, small = tube(50, 4.0), tube(50, smaller)
    both = Mesh(
        np.concatenate([large.vertices, small.vertices + 10.0]),
        np.concatenate([large.faces, small.faces + len(large.vertices)]),
    )
    assert (open_share(both) > INCOMPLETE) is counts


def test_the_rims_of_loose_bits_do_not_count() -> None:
    body = make_shape("octopus", 0)
    size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
    bits = Mesh(0.02 * size * np.random.default_rng(0).random((60, 3)), np.arange(60).reshape(20, 3))
    both = Mesh(
        np.concatenate([body.vertices, bits.vertices + size]),
        np.concatenate([body.faces, bits.faces + len(body.vertices)]),
    )
    assert open_share(both) == 0.0
    assert open_share(cut_part(body, 0.1, 0)) > 0.0
    assert open_share(make_soup(body, 0.02, 0)) == 0.0


def test_a_part_looks_incomplete_and_a_few_small_holes_do_not() -> None:
    for label in ("person", "octopus", "chair"):
        mesh = make_shape(label, 0)
        assert open_share(cut_part(mesh, 0.3, 0)) > INCOMPLETE
        assert 0.0 < open_share(remove_discs(mesh, 0.002, 0)) < INCOMPLETE


def test_it_is_among_the_facts_of_an_embedding() -> None:
    part = cut_part(make_shape("person", 0), 0.4, 1)
    assert Pipeline(DEFAULT).embed(part).facts.boundary_ratio == pytest.approx(open_share(part))
