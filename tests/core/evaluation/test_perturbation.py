"""Perturbations against what is known of them: how much moved, how much is gone, what is left."""

from functools import cache

import numpy as np
import pytest
import trimesh
from trimesh.proximity import closest_point_naive

from core.errors import ParameterError
from core.evaluation.perturbation import DISCS, LARGE_FACE, cut_part, remove_discs, subdivide
from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.mesh.simplification import MOST_WORK, SHORT, cluster_vertices, decimate
from tests.core.shapes import (
    area,
    as_trimesh,
    blob,
    box,
    folded,
    icosphere,
    joined,
    loose_parts,
    mesh_of,
    rectangle,
    shifted,
    soup,
)
from tests.gallery import make_shape
from tests.studies.perturbation import PARTS, add_noise, make_soup, separate_parts

AMOUNTS = {
    add_noise: 0.01,
    remove_discs: 0.3,
    cut_part: 0.3,
    decimate: 0.4,
    subdivide: 0.5,
    make_soup: 0.1,
    separate_parts: 0.02,
}
MESHES = {
    "person": cache(lambda: clean(make_shape("person", 0)).mesh),
    "blob": blob,
    "box of twelve faces": lambda: box(3, 2, 1),
    "table of loose parts": loose_parts,
    "three sheets on an edge": folded,
    "sheet": lambda: rectangle(3, 2, 18, 12),
    "soup": lambda: soup(icosphere(2)),
    "two blobs": lambda: joined(blob(1, 2), shifted(blob(2, 2), (4, 0, 0))),
}

every_perturbation = pytest.mark.parametrize("perturb", AMOUNTS, ids=lambda function: function.__name__)
every_mesh = pytest.mark.parametrize("mesh", MESHES, indirect=True)


@pytest.fixture
def mesh(request):
    return MESHES[request.param]()


def diagonal(mesh):
    return np.linalg.norm(np.ptp(mesh.vertices, axis=0))


def corners(mesh):
    return mesh.vertices[mesh.faces]


# All of them


@every_mesh
@every_perturbation
def test_the_same_seed_gives_the_same_mesh_and_it_can_be_cleaned(perturb, mesh):
    one, other = (perturb(mesh, AMOUNTS[perturb], 5) for _ in range(2))
    assert one.vertices.tobytes() == other.vertices.tobytes()
    assert one.faces.tobytes() == other.faces.tobytes()
    assert sorted(np.unique(one.faces)) == list(range(len(one.vertices)))
    assert np.isfinite(area(clean(one).mesh))


@every_perturbation
def test_another_seed_gives_another_mesh(perturb):
    one, other = (perturb(blob(), AMOUNTS[perturb], seed) for seed in (1, 2))
    assert one.vertices.tobytes() != other.vertices.tobytes()


@every_perturbation
def test_amounts_out_of_range_are_refused(perturb):
    with pytest.raises(ParameterError):
        perturb(blob(), -0.1, 0)
    with pytest.raises(ParameterError):
        perturb(blob(), float("nan"), 0)
    if perturb not in {add_noise, separate_parts}:
        with pytest.raises(ParameterError):
            perturb(blob(), 1.01, 0)


@pytest.mark.parametrize("perturb", [add_noise, remove_discs, cut_part, subdivide, make_soup, separate_parts])
def test_nothing_done_leaves_every_face_where_it_was(perturb):
    mesh = blob()
    assert (corners(perturb(mesh, 0.0, 3)) == corners(mesh)).all()
    assert decimate(mesh, 1.0, 3) is mesh


# Noise


@pytest.mark.parametrize("scale", [1.0, 300.0])
def test_noise_is_isotropic_and_has_the_deviation_it_says(scale):
    ball = icosphere(5, radius=scale)
    mesh = Mesh(ball.vertices * [1.0, 0.5, 0.2], ball.faces)
    noisy = add_noise(mesh, 0.004, 1)
    assert (noisy.faces == mesh.faces).all()
    shift = (noisy.vertices - mesh.vertices) / diagonal(mesh)
    # 10,242 draws; the standard error of a deviation is 0.7 per cent.
    assert shift.std(axis=0) == pytest.approx(np.full(3, 0.004), rel=0.03)
    assert np.abs(shift.mean(axis=0)).max() < 4 * 0.004 / np.sqrt(len(shift))
    assert np.abs(np.corrcoef(shift.T)[np.triu_indices(3, 1)]).max() < 0.04


# Parts of the surface gone


@every_mesh
@pytest.mark.parametrize("share", [0.1, 0.4])
@pytest.mark.parametrize("perturb", [remove_discs, cut_part])
def test_the_share_of_the_area_is_gone(perturb, share, mesh):
    found = perturb(mesh, share, 2)
    assert area(found) / area(mesh) == pytest.approx(1.0 - share, abs=LARGE_FACE / 2)


@pytest.mark.parametrize("perturb", [remove_discs, cut_part])
def test_the_remaining_faces_are_faces_of_the_mesh(perturb):
    mesh = MESHES["person"]()
    own = {face.tobytes() for face in corners(mesh)}
    left = [face.tobytes() for face in corners(perturb(mesh, 0.2, 4))]
    assert len(set(left)) == len(left) < len(own)
    assert own.issuperset(left)


def boundary_loops(mesh):
    """Boundary vertices of each hole, as points."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(ends, axis=0, return_counts=True)
    edges = edges[uses == 1]
    _, labels = component_labels(len(mesh.vertices), edges)
    rim = np.unique(edges)
    return [mesh.vertices[rim[labels[rim] == label]] for label in np.unique(labels[rim])]


@pytest.mark.parametrize("seed", range(3))
def test_holes_in_a_ball_are_round_and_equal(seed):
    loops = boundary_loops(remove_discs(icosphere(5), 0.01, seed))
    assert 2 <= len(loops) <= DISCS
    # Five caps of one radius r, apart from each other, have the area 5 * 2 pi (1 - cos r) of 4 pi.
    radius = np.arccos(1.0 - 2.0 * 0.01 / DISCS)
    for loop in loops:
        middle = loop.mean(axis=0) / np.linalg.norm(loop.mean(axis=0))
        angles = np.arccos(loop @ middle)
        if len(loops) == DISCS:
            assert angles.mean() == pytest.approx(radius, rel=0.1)
        assert angles.max() < 2.0 * radius
    assert len(boundary_loops(remove_discs(icosphere(5), 0.01, 0))) == DISCS


@pytest.mark.parametrize("share", [0.1, 0.3, 0.4])
def test_a_cap_is_cut_from_a_ball(share):
    ball = icosphere(5)
    left = corners(cut_part(ball, share, 3)).mean(axis=1)
    axis = -left.mean(axis=0) / np.linalg.norm(left.mean(axis=0))
    # Archimedes: a cap of that share of the area begins at the height 1 - 2 share.
    heights = corners(ball).mean(axis=1) @ axis
    edge = 1.0 - 2.0 * share
    assert (left @ axis).max() == pytest.approx(edge, abs=0.03)
    assert len(left) == pytest.approx((heights < edge).sum(), rel=0.01)


# Other meshing


@pytest.mark.parametrize("share", [0.5, 0.25, 0.1])
@pytest.mark.parametrize("name", ["person", "blob", "sheet", "two blobs"])
def test_decimation_keeps_the_share_of_the_faces_and_the_surface(name, share):
    mesh = MESHES[name]()
    found = decimate(mesh, share, 0)
    assert share * 0.85 * len(mesh.faces) <= len(found.faces) <= SHORT * share * len(mesh.faces) + 1
    _, away, _ = closest_point_naive(as_trimesh(mesh), found.vertices)
    assert away.max() < 0.05 * diagonal(mesh)
    assert area(found) == pytest.approx(area(mesh), rel=0.15)


@pytest.mark.parametrize("sections", [1000, 12000])
def test_a_fan_that_stalls_quadric_collapses_is_clustered(sections):
    cylinder = mesh_of(trimesh.creation.cylinder(1.0, 3.0, sections=sections))
    valences = np.bincount(cylinder.faces.ravel()).astype(float)
    assert (valences @ valences > MOST_WORK) == (sections == 12000)
    found = decimate(cylinder, 0.1, 0)
    assert len(found.faces) == pytest.approx(0.1 * len(cylinder.faces), rel=0.1)
    radius = np.hypot(found.vertices[:, 0], found.vertices[:, 1])
    assert radius.max() <= 1.0 + 1e-9
    assert np.ptp(found.vertices[:, 2]) == pytest.approx(3.0, rel=0.01)


def test_clusters_become_their_means():
    rng = np.random.default_rng(0)
    middles = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    points = middles.repeat(6, axis=0) + rng.uniform(-1e-3, 1e-3, size=(24, 3))
    triples = [[a, b, c] for a in range(4) for b in range(a + 1, 4) for c in range(b + 1, 4)]
    faces = [6 * np.array(face) + rng.integers(6, size=3) for face in triples for _ in range(8)]
    within = [[6 * i, 6 * i + 1, 6 * i + 2] for i in range(4)]
    found = cluster_vertices(Mesh(points, np.concatenate([faces, within])), 4, 1)
    means = points.reshape(4, 6, 3).mean(axis=1)
    order = np.argmin(np.linalg.norm(found.vertices[:, None] - means, axis=2), axis=1)
    assert sorted(order) == [0, 1, 2, 3]
    assert found.vertices == pytest.approx(means[order])
    assert sorted(sorted(face) for face in found.faces.tolist()) == triples


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_subdivision_keeps_the_surface_and_adds_two_faces_an_edge(share):
    mesh = blob()
    found = subdivide(mesh, share, 1)
    split = round(share * len(mesh.faces) * 3 / 2)
    assert (len(found.vertices), len(found.faces)) == (
        len(mesh.vertices) + split,
        len(mesh.faces) + 2 * split,
    )
    assert area(found) == pytest.approx(area(mesh), rel=1e-12)
    assert as_trimesh(found).is_watertight
    assert as_trimesh(found).volume == pytest.approx(as_trimesh(mesh).volume, rel=1e-12)


def test_all_edges_split_is_every_face_in_four():
    mesh = blob(subdivisions=2)
    found, truth = subdivide(mesh, 1.0, 0), as_trimesh(mesh).subdivide()
    assert in_order(found.vertices) == pytest.approx(in_order(truth.vertices))
    assert in_order(corners(found).mean(axis=1)) == pytest.approx(in_order(truth.triangles_center))


def in_order(points):
    return np.array(sorted(np.round(points, 9).tolist()))


# Pieces


@pytest.mark.parametrize("amount", [0.0, 0.02, 0.3])
def test_soup_shares_no_vertices_and_keeps_centroids(amount):
    mesh = MESHES["person"]()
    found = make_soup(mesh, amount, 1)
    assert sorted(found.faces.ravel().tolist()) == list(range(3 * len(mesh.faces)))
    assert corners(found).mean(axis=1) == pytest.approx(corners(mesh).mean(axis=1))
    lost = 1.0 - np.sqrt(face_areas(found.vertices, found.faces) / face_areas(mesh.vertices, mesh.faces))
    assert lost.mean() == pytest.approx(amount, rel=0.05, abs=1e-12)
    assert lost.min() >= 0.5 * amount - 1e-9
    assert lost.max() <= 1.5 * amount + 1e-9
    joins = clean(found)
    assert joins.components == (1 if amount == 0.0 else len(np.unique(joins.mesh.faces)) // 3)


def test_soup_whose_corners_coincide_is_cleaned_to_the_mesh():
    mesh = MESHES["person"]()
    one, other = clean(make_soup(mesh, 0.0, 0)).mesh, clean(mesh).mesh
    assert (one.vertices == other.vertices).all()
    assert (one.faces == other.faces).all()


@pytest.mark.parametrize("seed", range(3))
def test_parts_are_moved_as_they_are(seed):
    mesh = MESHES["person"]()
    found = separate_parts(mesh, 0.03, seed)
    moves = corners(found) - corners(mesh)
    assert np.ptp(moves, axis=1).max() < 1e-12 * diagonal(mesh)
    assert np.linalg.norm(moves[:, 0], axis=1) == pytest.approx(0.03 * diagonal(mesh))
    distinct, part = np.unique(np.round(moves[:, 0], 9), axis=0, return_inverse=True)
    assert 3 <= len(distinct) <= PARTS
    _, labels = component_labels(len(found.vertices), found.faces)
    for label in np.unique(labels):
        assert len(np.unique(part[labels[found.faces[:, 0]] == label])) == 1
