"""Our intrinsic Delaunay triangulation of closed surfaces against robust-laplacian's."""

import numpy as np
import pytest

from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.spectral.delaunay import intrinsic_delaunay, mollified_lengths, twins
from core.spectral.laplace_beltrami import _closed, tufted
from tests.core.shapes import GALLERY, MANY_KINDS, blob, box, icosphere, make_shape, rectangle, scaled


def slivers():
    """A ball pressed and turned, so that about half of its edges are to be flipped, some more than once."""
    ball = icosphere(3)
    angle = 3.0 * ball.vertices[:, 2]
    x, y = ball.vertices[:, 0], ball.vertices[:, 1]
    turned = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], axis=1)
    return Mesh(np.c_[turned * [1.0, 0.1], 4.0 * ball.vertices[:, 2]], ball.faces)


CLOSED = {
    **{label: lambda label=label: clean(make_shape(label, 1)).mesh for label in GALLERY[:8]},
    "ball": lambda: icosphere(2),
    "blob": blob,
    "small blob": lambda: scaled(blob(), 1e-3),
    "slivers": slivers,
}


@pytest.mark.parametrize("kind", CLOSED)
def test_weights_and_areas_are_robust_laplacians(kind):
    mesh = CLOSED[kind]()
    found = _closed(mesh)
    assert found is not None
    stiffness, areas = tufted(mesh)
    assert abs(found[0] - stiffness).max() < 1e-6 * abs(stiffness).max()
    np.testing.assert_allclose(found[1], areas, rtol=1e-6)


def test_no_weight_is_negative_though_many_were():
    mesh = slivers()
    start, end, weights, _ = intrinsic_delaunay(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    stiffness = _closed(mesh)[0].toarray()
    assert stiffness[~np.eye(len(stiffness), dtype=bool)].max() < 1e-5
    before = {frozenset(edge) for edge in half_edges(mesh.faces).edges.tolist()}
    after = {frozenset(edge) for edge in zip(start.tolist(), end.tolist(), strict=True)}
    assert len(after - before) > 100
    assert weights.min() < 0.0


def test_flips_leave_the_area_alone():
    mesh = slivers()
    *_, areas = intrinsic_delaunay(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    assert areas.sum() == pytest.approx(face_areas(mesh.vertices, mesh.faces).sum(), rel=1e-9)


def test_a_cube_needs_no_flip():
    """Its diagonals have weight 0, its edges 1."""
    cube = box(1.0, 1.0, 1.0)
    stiffness, areas = _closed(cube)
    assert areas.sum() == pytest.approx(face_areas(cube.vertices, cube.faces).sum(), rel=1e-4)
    edges = half_edges(cube.faces).edges
    weights = -np.asarray(stiffness[edges[:, 0], edges[:, 1]]).ravel()
    lengths = np.linalg.norm(cube.vertices[edges[:, 0]] - cube.vertices[edges[:, 1]], axis=1)
    np.testing.assert_allclose(weights[lengths > 1.01 * lengths.min()], 0.0, atol=1e-4)


BALL = icosphere(1)
OPEN = {
    "sheet": rectangle(1.0, 1.0, 4, 4),
    "three sheets on an edge": MANY_KINDS["three sheets on an edge"](),
    "one face turned over": Mesh(BALL.vertices, np.r_[BALL.faces[:1, ::-1], BALL.faces[1:]]),
}


@pytest.mark.parametrize("kind", OPEN)
def test_other_surfaces_are_left_to_the_cover(kind):
    mesh = OPEN[kind]
    assert twins(mesh.faces, half_edges(mesh.faces)) is None
    assert _closed(mesh) is None


def test_every_triangle_is_made_longer_than_a_line():
    lengths = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 1.0]])
    longer = mollified_lengths(lengths)
    assert (longer.sum(axis=1) - 2.0 * longer.max(axis=1)).min() == pytest.approx(
        1e-5 * lengths.mean(), rel=1e-6
    )
    np.testing.assert_array_equal(mollified_lengths(lengths[1:]), lengths[1:])
