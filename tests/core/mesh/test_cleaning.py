"""Cleaning: what is merged, dropped and kept."""

from functools import partial

import numpy as np
import pytest

from core.errors import DegenerateMeshError
from core.mesh.cleaning import centroid, clean, face_areas
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from tests.core.shapes import (
    MANY_KINDS,
    SAME_SHAPE,
    area,
    areas,
    blob,
    box,
    faces_shuffled,
    icosphere,
    joined,
    loose_parts,
    scaled,
    shifted,
    soup,
    turned,
    vertices_shuffled,
    volume,
)

torn = partial(soup, shrink=1.0)
"""The same faces, each with corners of its own in the same places, as an STL file has them."""


def triangles(mesh):
    """The places of each face's corners, in an order of their own."""
    corners = np.round(mesh.vertices[mesh.faces], 9) + 0.0
    return sorted(sorted(map(tuple, face)) for face in corners.tolist())


def test_corners_in_the_same_place_become_one_vertex():
    cleaned = clean(torn(box(3, 2, 1)))
    assert cleaned.mesh.vertices.shape == (8, 3)
    assert cleaned.mesh.faces.shape == (12, 3)
    assert (cleaned.components, cleaned.merged_vertices, cleaned.dropped_faces) == (1, 28, 0)
    assert triangles(cleaned.mesh) == triangles(box(3, 2, 1))


@pytest.mark.parametrize("seed", range(3))
def test_rounding_of_single_precision_does_not_tear_a_surface(seed):
    ball = torn(turned(icosphere(3), seed))
    far = Mesh((ball.vertices + 0.25).astype(np.float32), ball.faces)
    assert len(clean(far).mesh.vertices) == len(icosphere(3).vertices)
    assert clean(far).components == 1


def test_a_detail_of_a_thousandth_of_a_percent_is_kept():
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [1, 1e-5, 0], [0, 1, 0]], [[0, 1, 3], [1, 2, 3]])
    assert len(clean(mesh).mesh.vertices) == 4


def test_a_clean_mesh_stays_as_it_is():
    mesh = blob()
    cleaned = clean(mesh)
    assert (cleaned.components, cleaned.merged_vertices, cleaned.dropped_faces) == (1, 0, 0)
    assert triangles(cleaned.mesh) == triangles(mesh)
    assert area(cleaned.mesh) == pytest.approx(area(mesh))


def test_faces_on_a_point_or_a_line_and_repeated_ones_are_dropped():
    ball = icosphere(1)
    a, b, c = ball.faces[7]
    more = [[a, a, b], [b, b, b], [c, b, a], [b, c, a]]
    cleaned = clean(Mesh(ball.vertices, np.concatenate([ball.faces, more])))
    assert cleaned.dropped_faces == len(more)
    assert triangles(cleaned.mesh) == triangles(ball)


def test_winding_is_kept():
    ball = icosphere(2)
    cleaned = clean(faces_shuffled(vertices_shuffled(ball, 1), 2)).mesh
    assert volume(cleaned) == pytest.approx(volume(ball))


def test_a_sliver_that_holds_two_faces_together_stays():
    # The middle face has no area: its corners lie on a line.
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [2, -1, 0]], [[0, 2, 3], [0, 1, 2], [1, 2, 4]])
    cleaned = clean(mesh)
    assert len(cleaned.mesh.faces) == 3
    assert cleaned.components == 1


def test_vertices_of_no_face_go():
    ball = icosphere(1)
    mesh = Mesh(np.concatenate([ball.vertices, [[5.0, 5.0, 5.0], [0.0, 0.0, 0.0]]]), ball.faces)
    assert len(clean(mesh).mesh.vertices) == len(ball.vertices)


def test_dust_goes():
    dust = [shifted(icosphere(0, 0.005), (1.5 + 0.1 * i, 0, 0)) for i in range(10)]
    cleaned = clean(joined(*dust, icosphere(3)))
    assert cleaned.components == 1
    assert cleaned.dropped_faces == 200
    assert triangles(cleaned.mesh) == triangles(icosphere(3))


@pytest.mark.parametrize("parts", [2, 30, 1500])
@pytest.mark.parametrize("seed", [0, 1])
def test_equal_parts_of_an_assembly_all_stay(parts, seed):
    pile = joined(*(shifted(turned(box(1, 2, 3), i), (5 * i, 0, 0)) for i in range(parts)))
    cleaned = clean(turned(pile, seed))
    assert cleaned.components == parts
    assert cleaned.dropped_faces == 0


def test_a_large_part_and_a_tenth_of_it_both_stay():
    assert clean(joined(icosphere(2, 1.0), shifted(icosphere(2, 0.3), (3, 0, 0)))).components == 2
    assert clean(loose_parts()).components == 5


def test_labels_are_the_components():
    cleaned = clean(joined(box(1, 1, 1), shifted(icosphere(1), (4, 0, 0))))
    number, labels = component_labels(len(cleaned.mesh.vertices), cleaned.mesh.faces)
    assert number == cleaned.components == 2
    assert (labels == cleaned.labels).all()
    right = cleaned.mesh.vertices[:, 0] > 2
    assert len(np.unique(cleaned.labels[right])) == len(np.unique(cleaned.labels[~right])) == 1


@pytest.mark.parametrize("change", SAME_SHAPE.values(), ids=SAME_SHAPE)
def test_counts_do_not_hang_on_how_the_mesh_is_given(change):
    dust = [shifted(icosphere(0, 0.004), (1.5 + 0.1 * i, 0, 0)) for i in range(5)]
    mesh = torn(joined(blob(subdivisions=2), *dust))
    plain, changed = clean(mesh), clean(change(mesh))
    for name in ("components", "merged_vertices", "dropped_faces"):
        assert getattr(plain, name) == getattr(changed, name)
    assert len(plain.mesh.vertices) == len(changed.mesh.vertices)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        pytest.param(np.ones((3, 3)), [[0, 1, 2]], id="one point"),
        pytest.param([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]], id="a line"),
        pytest.param([[0, 0, 0], [1, 2, 3], [2, 4, 6.0000000000001]], [[0, 1, 2]], id="almost a line"),
        pytest.param([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 1], [2, 2, 2]], id="repeated corners"),
        pytest.param([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0]], id="one corner"),
    ],
)
def test_refuses_what_has_no_area(vertices, faces):
    with pytest.raises(DegenerateMeshError):
        clean(Mesh(vertices, faces))


@pytest.mark.parametrize("factor", [1e-30, 1e-12, 1e12, 1e30])
def test_works_at_any_scale_a_file_may_have(factor):
    cleaned = clean(scaled(torn(icosphere(2)), factor))
    assert len(cleaned.mesh.vertices) == len(icosphere(2).vertices)


@pytest.mark.parametrize("factor", [1e39, 1e100, 1e200, 1e308])
def test_refuses_what_is_too_large_to_measure(factor):
    with pytest.raises(DegenerateMeshError, match="too far apart"):
        clean(scaled(icosphere(1), factor))


@pytest.mark.parametrize("kind", MANY_KINDS)
def test_compiled_areas_and_centroid_are_the_plain_ones(kind):
    mesh = MANY_KINDS[kind]()
    np.testing.assert_allclose(face_areas(mesh.vertices, mesh.faces), areas(mesh), rtol=1e-12, atol=1e-15)
    centre = areas(mesh) @ mesh.vertices[mesh.faces].mean(axis=1) / area(mesh)
    np.testing.assert_allclose(centroid(mesh.vertices, mesh.faces, areas(mesh)), centre, atol=1e-12)
