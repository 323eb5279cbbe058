"""Correspondences of symmetric shapes keep left and right; those of mirror images are told."""

from dataclasses import replace

import numpy as np
import pytest

from core.embedding import NO_ORIENTATION
from core.evaluation.correspondence_errors import REMESHED, surface_distances, symmetric_error
from core.matching import oriented_map
from core.mesh.mesh import Mesh
from core.pipeline import MAPS, Pipeline
from tests.core.shapes import icosphere
from tests.gallery import make_body

PIPELINE = Pipeline()
MIRROR = np.diag([1.0, 1.0, -1.0])


def mirror_image(mesh):
    return Mesh(mesh.vertices @ MIRROR, mesh.faces[:, [0, 2, 1]])


def chiral(size=4):
    """A ball with bumps that no reflection maps onto itself."""
    ball = icosphere(size)
    x, y, z = ball.vertices.T
    radii = 1.0 + 0.25 * x + 0.3 * x * y + 0.3 * y * z**2 + 0.35 * x * y * z
    return Mesh(ball.vertices * radii[:, None], ball.faces)


@pytest.fixture(scope="module")
def quadruped():
    """A body and its poses, embedded."""
    body = make_body("quadruped", 0)
    return body, [PIPELINE.embed(body.posed(pose)) for pose in range(4)]


def errors(body, one, other, match):
    """Mean distances at rest of the found partners from the true ones, and from their mirror images."""
    truth = body.partners(body)
    i, j = match.correspondence.T
    ends = body.rest.vertices[other.vertices[j]]
    return [np.linalg.norm(ends - body.rest.vertices[row[one.vertices[i]]], axis=1).mean() for row in truth]


def test_poses_of_a_symmetric_body_keep_left_and_right(quadruped):
    body, poses = quadruped
    for a in range(4):
        for b in range(4):
            if a != b:
                match = PIPELINE.match(poses[a], poses[b])
                direct, exchanged = errors(body, poses[a], poses[b], match)
                # The body is nearly its own mirror image.
                assert match.mirrored is None
                assert direct < exchanged


def test_scores_do_not_depend_on_orientation(quadruped):
    _, poses = quadruped
    plains = [replace(pose, orientation=NO_ORIENTATION) for pose in poses[1:3]]
    expected, found = PIPELINE.match(*plains), PIPELINE.match(*poses[1:3])
    assert (found.cc, found.ssd, found.sim) == (expected.cc, expected.ssd, expected.sim)
    assert expected.mirrored is None


def test_the_order_of_two_shapes_does_not_matter(quadruped):
    _, poses = quadruped
    there, back = PIPELINE.match(poses[0], poses[1]), PIPELINE.match(poses[1], poses[0])
    pairs = {tuple(pair) for pair in there.correspondence.tolist()}
    assert {(i, j) for j, i in back.correspondence.tolist()} == pairs
    assert there.mirrored == back.mirrored


def test_the_mirror_image_of_a_chiral_shape_is_told():
    shape = PIPELINE.embed(chiral())
    image = PIPELINE.embed(mirror_image(chiral()))
    assert PIPELINE.match(shape, image).mirrored is True
    assert PIPELINE.match(shape, PIPELINE.embed(mirror_image(mirror_image(chiral())))).mirrored is False


def test_samples_do_not_tell_the_mirror_image_of_a_symmetric_body(quadruped):
    body, poses = quadruped
    assert PIPELINE.match(poses[0], PIPELINE.embed(mirror_image(body.posed(1)))).mirrored is None


def test_faces_turned_every_way_leave_it_open():
    mesh = chiral()
    faces = mesh.faces.copy()
    faces[::2] = faces[::2][:, [0, 2, 1]]
    mixed = PIPELINE.embed(Mesh(mesh.vertices, faces))
    assert mixed.orientation.size == 0
    assert PIPELINE.match(PIPELINE.embed(mesh), mixed).mirrored is None


def test_a_map_that_the_search_misses_is_found_by_the_symmetries_of_the_body():
    """From one of these poses to the other, the search finds the exchange of the sides alone."""
    body, other = make_body("person", 0), make_body("person", 0, vertices=REMESHED)
    one, two = PIPELINE.embed(body.posed(0)), PIPELINE.embed(other.posed(2))
    truth, distances = body.partners(other)[:1], surface_distances(other)
    found, mirrored = PIPELINE.correspondences(one, two)
    errors = [
        symmetric_error(distances, truth, one.vertices[pairs[:, 0]], two.vertices[pairs[:, 1]])[0]
        for pairs in found
    ]
    assert mirrored is not None
    assert min(error for error, reverses in zip(errors, mirrored, strict=True) if not reverses) < 0.06


def test_the_only_map_that_fits_may_reverse_orientation(monkeypatch):
    """The symmetries of the second shape alone show the map that fits best."""
    monkeypatch.setattr(oriented_map, "FITS_AS_WELL", 0.0)
    one, two = (
        PIPELINE.embed(make_body(label, 1, vertices=600).posed(0), ()) for label in ("octopus", "teddy")
    )
    turned = replace(two, orientation=-two.orientation)
    kinds = [PIPELINE.correspondences(one, other)[1] for other in (two, turned)]
    assert sorted(kinds) == [[False], [True]]


def test_half_as_many_maps_reverse_where_symmetries_of_the_second_shape_alone_show_the_others(monkeypatch):
    """The search and the symmetries of the first octopus find reflections alone, and every map fits."""
    body = make_body("octopus", 0, vertices=600)
    one, two = (PIPELINE.embed(body.posed(pose), ()) for pose in (0, 1))
    search, compose, agreements = oriented_map._maps, oriented_map._composed, oriented_map._agreements

    def reflections(x, maps):
        signs = agreements(x, maps, (one.orientation, two.orientation), domain=1)
        return tuple(each[signs < 0.0] for each in maps)

    def searched(x, y, rounds):
        maps = search(x, y, rounds)
        return maps if x is y else reflections(x, maps)

    def composed(x, y, rounds, maps, *, of_second):
        found = compose(x, y, rounds, maps, of_second=of_second)
        return found if of_second else reflections(x, found)

    monkeypatch.setattr(oriented_map, "_maps", searched)
    monkeypatch.setattr(oriented_map, "_composed", composed)
    monkeypatch.setattr(oriented_map, "FITS_AS_WELL", 1.0)
    kinds = PIPELINE.correspondences(one, two)[1]
    assert len(kinds) > sum(kinds) == MAPS // 2
