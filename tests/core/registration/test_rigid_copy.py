"""Rigid copies, mirror images and variants, told by samples and by surfaces."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from core.descriptors.pieces import pieces
from core.embedding import Embedding
from core.evaluation.perturbation import subdivide
from core.gallery.solids import Frame, ellipsoid, tube
from core.gallery.surface import surface
from core.io import read_mesh, write_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.ranking.shortlist import spectral_distances
from core.registration.probed_surface import ProbedSurface, probed_surface
from core.registration.rigid_copy import (
    COPY_RADIUS,
    EQUAL_RADIUS,
    EQUAL_VOLUME,
    Difference,
    Proportions,
    RigidCopy,
    _has_equal_sides,
    copy_by_samples,
    copy_by_surfaces,
    have_equal_axes,
    may_be_copy,
    proportions,
)
from core.registration.similarity import RESIDUAL, Similarity
from tests.gallery import make_body
from tests.studies.copies import moved, quartered, simplified
from tests.studies.likeness import part as chiral_part
from tests.studies.likeness import screw
from tests.studies.machine_parts import LONGER, Change, Drawing, Family, extruded, mesh_of, part

PIPELINE = Pipeline()
UNCOMPARED = Similarity(1.0, np.eye(3), np.zeros(3))


def a_copy(scale: float, *, mirrored: bool, rel: float) -> RigidCopy:
    """Equal to each copy of about this scale that has no local difference."""
    within = pytest.approx(0.0, abs=RESIDUAL)
    return RigidCopy(
        pytest.approx(scale, rel=rel), mirrored=mirrored, residual=within, difference=None, placing=UNCOMPARED
    )


embedded = partial(PIPELINE.embed, descriptors=())


@cache
def hand() -> Mesh:
    return make_body("hand").posed(0)


@cache
def embedded_hand() -> Embedding:
    return embedded(hand())


def gate(second: Embedding) -> bool:
    first = embedded_hand()
    return may_be_copy(spectral(first, second), proportions_of(first), proportions_of(second))


def proportions_of(embedding: Embedding) -> Proportions:
    facts = embedding.facts
    return proportions(
        area=facts.area, volume=facts.volume, scale=facts.scale, boundary_edges=facts.boundary_edges
    )


def spectral(first: Embedding, second: Embedding) -> float:
    return float(spectral_distances(first.signature, second.signature[None])[0])


def by_samples(second: Embedding) -> RigidCopy | None:
    return copy_by_samples(embedded_hand(), second, spectral(embedded_hand(), second))


def probed(first: Mesh, second: Mesh) -> tuple[ProbedSurface, ProbedSurface, tuple[np.ndarray, np.ndarray]]:
    """Return both surfaces and the points that match."""
    one, other = embedded(first), embedded(second)
    return probed_surface(first), probed_surface(second), PIPELINE.match(one, other).points(one, other)


def by_surfaces(first: Mesh, second: Mesh) -> RigidCopy | None:
    return copy_by_surfaces(*probed(first, second))


@pytest.mark.parametrize("scale", [1.0, 1.5, 25.4, 1 / 3])
def test_the_samples_of_a_turned_copy_tell_its_scale(scale: float) -> None:
    second = embedded(moved(hand(), 1, scale=scale))
    assert gate(second)
    for pair, expected in (((embedded_hand(), second), scale), ((second, embedded_hand()), 1.0 / scale)):
        found = copy_by_samples(*pair, spectral(*pair))
        assert found == a_copy(expected, mirrored=False, rel=1e-5)


@pytest.mark.parametrize("remeshed", [lambda: subdivide(hand(), 0.4, 1), lambda: simplified(hand())])
def test_the_surface_of_a_copy_on_another_mesh_tells_its_scale(remeshed: Callable[[], Mesh]) -> None:
    copy = moved(remeshed(), 2, scale=2.0)
    second = embedded(copy)
    assert gate(second)
    assert by_samples(second) is None
    assert by_surfaces(hand(), copy) == a_copy(2.0, mirrored=False, rel=0.01)


def test_surfaces_of_one_total_radius_are_told_apart_along_their_axes() -> None:
    size, volume, *radii, count = embedded_hand().pieces[0].tolist()
    long, flat = sorted(radii), [(sum(r * r for r in radii) / 2) ** 0.5] * 2
    rows = np.array([[size, volume, 0.0, *flat, count]], dtype=np.float32)
    assert np.linalg.norm(rows[0, 2:5]) == pytest.approx(np.linalg.norm(long), rel=1e-6)
    other = replace(embedded_hand(), pieces=rows)
    assert have_equal_axes(embedded_hand(), embedded_hand())
    assert not have_equal_axes(embedded_hand(), other)
    assert not have_equal_axes(other, embedded_hand())
    assert have_equal_axes(embedded_hand(), replace(other, pieces=np.concatenate([rows, rows])))


@pytest.mark.parametrize("change", ["hole", "moved", "larger", "fillet", "longer"])
def test_the_axes_of_variants_and_copies_are_equal(change: Change) -> None:
    drawings = Drawing(5, 0.1), Drawing(5, 0.1, change=change), Drawing(5, 0.05, 0.4)
    for family in ("bracket", "shaft", "plate"):
        rows = []
        for drawing in drawings:
            cleaned = clean(moved(part(family, drawing), 3))
            rows.append(replace(embedded_hand(), pieces=pieces(cleaned.mesh, cleaned.labels)))
        assert have_equal_axes(rows[0], rows[1])
        assert have_equal_axes(rows[0], rows[2])


def test_a_mirror_image_is_told_by_surfaces() -> None:
    image = moved(hand(), 4, scale=1.5, mirrored=True)
    told = a_copy(1.5, mirrored=True, rel=0.01)
    assert gate(embedded(image))
    assert by_samples(embedded(image)) is None
    assert by_surfaces(hand(), image) == told
    assert by_surfaces(hand(), moved(simplified(hand()), 6, scale=1.5, mirrored=True)) == told


@pytest.mark.parametrize(("mirrored", "change"), [(False, None), (True, None), (False, "hole")])
def test_the_transform_of_a_copy_or_a_variant_takes_it_back(mirrored: bool, change: Change | None) -> None:
    first, second = part("bracket", Drawing(8, 0.05)), part("bracket", Drawing(8, 0.05, 0.37, change))
    there = moved(second, 4, scale=2.5, mirrored=mirrored)
    found = judged(first, there)
    assert found is not None
    assert (found.mirrored, found.difference is None) == (mirrored, change is None)
    ends = np.column_stack([there.vertices, np.ones(len(there.vertices))])
    assert np.abs((ends @ found.placing.matrix.T)[:, :3] - second.vertices).max() <= 0.02


def test_the_transform_by_samples_takes_a_copy_back() -> None:
    copy = moved(hand(), 1, scale=25.4)
    found = by_samples(embedded(copy))
    assert found is not None
    assert np.abs(found.placing.apply(copy.vertices) - hand().vertices).max() <= 1e-4


def test_a_symmetric_body_is_a_copy_of_its_mirror_image() -> None:
    cup = make_body("cup").rest
    found = by_surfaces(cup, moved(cup, 5, scale=3.0, mirrored=True))
    assert found == a_copy(3.0, mirrored=False, rel=0.01)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_thread_on_another_mesh_turns_left_or_right(mirrored: bool) -> None:
    copy = moved(chiral_part(screw, 2, 2600), 7, mirrored=mirrored)
    assert by_surfaces(chiral_part(screw, 2), copy) == a_copy(1.0, mirrored=mirrored, rel=0.01)


@pytest.mark.parametrize(("high", "chiral"), [(0.0, False), (0.2, True)])
def test_a_ring_with_two_studs_is_chiral_if_one_is_off_its_plane(high: float, chiral: bool) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(61)], axis=1)
    studs = [(1.2, 0.0, 0.0), (float(np.cos(2.0)), float(np.sin(2.0)), high)]
    parts = [tube(circle, [0.15] * 61, blend=0.01)]
    parts += [ellipsoid(Frame().move(*stud), (0.12, 0.12, 0.12), blend=0.02) for stud in studs]
    ring, other = (Mesh(*surface(parts, vertices)) for vertices in (2000, 2600))
    assert by_surfaces(ring, moved(other, 3)) == a_copy(1.0, mirrored=False, rel=0.01)
    image = moved(other, 4, mirrored=True)
    assert by_surfaces(ring, image) == a_copy(1.0, mirrored=chiral, rel=0.01)


def test_a_pose_and_another_shape_are_no_copies() -> None:
    pose, octopus = make_body("hand", vertices=1800).posed(1), make_body("octopus").posed(0)
    assert by_surfaces(hand(), pose) is None
    assert by_surfaces(hand(), octopus) is None
    assert not gate(embedded(octopus))


def test_other_radii_or_eigenvalues_are_those_of_no_copy() -> None:
    first = Proportions(0.5, 0.05)
    assert may_be_copy(0.0, first, Proportions(0.5 + 0.9 * COPY_RADIUS, 0.02))
    assert not may_be_copy(0.0, first, Proportions(0.5 + 1.1 * COPY_RADIUS, 0.05))
    # Far eigenvalues need equal proportions; the volume of an open surface is unknown.
    assert may_be_copy(1.0, first, Proportions(0.5 + 0.9 * EQUAL_RADIUS, 0.05 * (1.0 + 0.9 * EQUAL_VOLUME)))
    assert not may_be_copy(1.0, first, Proportions(0.5, 0.05 * (1.0 + 1.1 * EQUAL_VOLUME)))
    assert not may_be_copy(1.0, first, Proportions(0.5 + 1.1 * EQUAL_RADIUS, 0.05))
    assert may_be_copy(1.0, first, Proportions(0.5, None))


def judged(first: Mesh, second: Mesh) -> RigidCopy | None:
    """By what remains of both in an STL; a search for copies alone finds the same, but no variant."""
    surfaces = probed(*(read_mesh(write_mesh(mesh, "stl"), "stl") for mesh in (first, second)))
    found = copy_by_surfaces(*surfaces)
    is_copy = found is not None and found.difference is None
    assert copy_by_surfaces(*surfaces, variants=False) == (found if is_copy else None)
    return found


CHANGES: dict[Family, Change] = {
    **{"plate": "hole", "bracket": "moved", "flange": "larger"},
    **{"gear": "fillet", "shaft": "longer", "housing": "larger"},
}


@pytest.mark.parametrize("family", CHANGES)
def test_a_remeshed_copy_is_a_copy_and_its_scale_is_exact(family: Family) -> None:
    first, second = (part(family, Drawing(5, 0.05, phase)) for phase in (0.0, 0.37))
    assert judged(first, moved(second, 1, scale=25.4)) == a_copy(25.4, mirrored=False, rel=1e-4)


@pytest.mark.parametrize(("family", "rel"), [("gear", 1e-7), ("bracket", 1e-7), ("shaft", 5e-6)])
def test_planes_tell_the_scale_of_an_export_at_another_tolerance(family: Family, rel: float) -> None:
    """The walls of holes differ by chord errors, planes by rounding."""
    first, second = part(family, Drawing(6, 0.1)), part(family, Drawing(6, 0.02, 0.37))
    assert judged(first, moved(second, 1, scale=25.4)) == a_copy(25.4, mirrored=False, rel=rel)


def test_planes_are_planar_unless_they_bend_smoothly_to_another_facet() -> None:
    """A prism has none but planes; the walls of holes bend, and fillets to the planes that they meet."""
    square = [(0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0)]
    assert probed_surface(mesh_of(extruded(square, 1.0))).curved.planar.all()
    drilled, rounded = (probed_surface(part(name, Drawing(5, 0.05))).curved for name in ("plate", "tray"))
    for curved in (drilled, rounded):
        assert curved.planar.any()
        assert not curved.planar[curved.own > 0.0].any()
    assert not rounded.planar[rounded.own == 0.0].all()


def test_a_thread_with_vertices_elsewhere_is_a_copy() -> None:
    """Its crests and roots are cut off, by less than the tolerance."""
    bolts = [part("bolt", Drawing(383, 0.1, phase)) for phase in (0.0, 0.37)]
    surfaces = probed_surface(bolts[0]), probed_surface(moved(bolts[1], 3, scale=2.0))
    starts = [one.samples.representatives * one.samples.unit + one.samples.centre for one in surfaces]
    assert copy_by_surfaces(*surfaces, (starts[0], starts[1])) == a_copy(2.0, mirrored=False, rel=1e-4)


@pytest.mark.parametrize("family", ["plate", "flange", "gear", "shaft"])
def test_triangles_cut_in_four_make_a_copy_to_rounding(family: Family) -> None:
    mesh = part(family, Drawing(9, 0.1))
    found = judged(mesh, moved(quartered(mesh), 5, scale=2.0))
    assert found == a_copy(2.0, mirrored=False, rel=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("family", ["flange", "shaft"])
def test_a_facet_in_a_hundred_that_is_missing_changes_nothing(family: Family, mirrored: bool) -> None:
    """A symmetric part is its own mirror image also then: what lies in the gap is unknown."""
    mesh = part(family, Drawing(9, 0.01))
    kept = np.random.default_rng(0).permutation(len(mesh.faces))[len(mesh.faces) // 100 :]
    found = judged(mesh, moved(Mesh(mesh.vertices, mesh.faces[kept]), 6, mirrored=mirrored))
    assert found == a_copy(1.0, mirrored=False, rel=1e-3)


@pytest.mark.parametrize("family", ["bracket", "housing"])
def test_a_part_with_two_hands_is_mirrored(family: Family) -> None:
    first, second = (part(family, Drawing(6, 0.05, phase)) for phase in (0.0, 0.37))
    found = judged(first, moved(second, 2, scale=1 / 3, mirrored=True))
    assert found == a_copy(1 / 3, mirrored=True, rel=1e-4)


@pytest.mark.parametrize(("family", "change"), CHANGES.items())
def test_a_part_with_a_change_is_a_variant(family: Family, change: Change) -> None:
    first, second = part(family, Drawing(7, 0.1)), part(family, Drawing(7, 0.1, change=change))
    found = judged(first, moved(second, 3, scale=2.0))
    assert found is not None
    assert found.difference is not None
    assert found.scale == pytest.approx(2.0, rel=1e-3)


def test_another_drawing_with_all_sides_different_is_no_variant() -> None:
    first, second = (part("bracket", Drawing(number, 0.1)) for number in (50001, 50021))
    assert judged(first, moved(second, 3)) is None


@pytest.mark.parametrize(("height", "equal"), [(1e-9, True), (0.1, False)])
def test_rounding_of_a_flat_part_is_no_third_side(height: float, equal: bool) -> None:
    sides = (60.0, 40.0, 0.0), (61.0, 40.0, height)
    nowhere = (0.0, 0.0, 0.0)
    difference = Difference(nowhere, nowhere, nowhere, 1.0, sides, None, 1.0, None)
    assert _has_equal_sides(difference) == equal


def even(kind: str, level: int) -> Mesh:
    """A smooth body of about 100 mm, with triangles of one size."""
    made = trimesh.creation.icosphere(level, 50.0)
    if kind == "torus":
        made = trimesh.creation.torus(35.0, 15.0, major_sections=20 * level, minor_sections=8 * level)
    squeeze = [1.0, 0.7, 0.5] if kind == "ellipsoid" else [1.0, 1.0, 1.0]
    return Mesh(np.array(made.vertices) * squeeze, np.array(made.faces))


@pytest.mark.parametrize(
    ("kind", "level", "height", "width"),
    [
        *[("sphere", 3, 4.0, 25.0), ("ellipsoid", 5, 1.0, 4.0), ("torus", 3, -2.0, 35.0)],
        *[("sphere", 4, 3.0, 8.0), ("torus", 4, -2.0, 8.0), ("torus", 4, 1.0, 12.0)],
    ],
)
def test_a_smooth_bump_or_dent_on_an_even_mesh_makes_a_variant(
    kind: str, level: int, height: float, width: float
) -> None:
    """It is as high, or deep, as the surfaces are apart."""
    mesh = even(kind, level)
    place = np.random.default_rng(level).integers(len(mesh.vertices))
    away = np.linalg.norm(mesh.vertices - mesh.vertices[place], axis=1) / width
    rise = height * np.where(away < 1.0, np.cos(0.5 * np.pi * away) ** 2, 0.0)
    normals = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).vertex_normals
    bumped = Mesh(mesh.vertices + rise[:, None] * normals, mesh.faces)
    surfaces = probed_surface(mesh), probed_surface(moved(bumped, 3, scale=2.0))
    starts = [one.samples.representatives * one.samples.unit + one.samples.centre for one in surfaces]
    found = copy_by_surfaces(*surfaces, (starts[0], starts[1]))
    assert found is not None
    assert found.difference is not None
    assert found.scale == pytest.approx(2.0, rel=1e-3)
    assert found.difference.distance == pytest.approx(abs(height), rel=0.1)


@pytest.mark.parametrize("bend", [60.0, 90.0])
def test_even_meshes_whose_vertices_follow_no_edge_are_copies(bend: float) -> None:
    """Scans of a lens: spherical caps that meet at a rim, at an angle that triangles do not follow."""
    middle = np.cos(0.5 * np.radians(bend))
    lenses = []
    for seed in (1, 2):
        ball = moved(even("sphere", 4), seed).vertices - [2.0, 0.0, -3.0]
        ways = ball / np.linalg.norm(ball, axis=1)[:, None]
        heights = middle * np.abs(ways[:, 2])
        radii = np.sqrt(1.0 - middle**2 + heights**2) - heights
        lenses.append(Mesh(50.0 * radii[:, None] * ways * [1.0, 0.8, 1.0], even("sphere", 4).faces))
    surfaces = probed_surface(lenses[0]), probed_surface(moved(lenses[1], 3, scale=2.0))
    ends = lenses[0].vertices, moved(lenses[0], 3, scale=2.0).vertices
    assert copy_by_surfaces(*surfaces, ends) == a_copy(2.0, mirrored=False, rel=0.01)


def test_a_hole_of_a_hundredth_of_the_length_makes_a_variant() -> None:
    """Few probes lie on its eight facets."""
    plate = Manifold.cube((100.0, 70.0, 5.0))
    hole = Manifold.cylinder(5.0, 0.5, circular_segments=8).translate((40.0, 30.0, 0.0))
    found = by_surfaces(mesh_of(plate), moved(mesh_of(plate - hole), 3))
    assert found is not None
    assert found.difference is not None
    assert found.difference.through_holes == (0, 1)


@pytest.mark.parametrize("family", ["plate", "gear", "shaft", "flange", "bracket", "housing"])
def test_a_longer_part_differs_by_what_it_is_longer(family: Family) -> None:
    """Also where a part that is turned end for end leaves fewer points that deviate."""
    first, second = part(family, Drawing(7, 0.05)), part(family, Drawing(7, 0.05, change="longer"))
    found = by_surfaces(first, moved(second, 3, scale=2.0))
    assert found is not None
    assert found.difference is not None
    changes = np.subtract(*found.difference.sides[::-1])
    assert sorted(np.abs(changes)) == pytest.approx([0.0, 0.0, LONGER], abs=0.02)
    assert found.difference.distance <= LONGER + 0.02


@pytest.mark.parametrize("kinds", [("plain", "plain"), ("plain", "quartered"), ("fine", "quartered")])
@pytest.mark.parametrize("thickness", [6.0, 4.0])
def test_a_plate_of_another_thickness_is_a_variant_on_every_mesh(
    kinds: tuple[str, str], thickness: float
) -> None:
    surfaces = []
    for kind, thick in zip(kinds, (5.0, thickness), strict=True):
        drawing = Drawing(1, 0.01 if kind == "fine" else 0.1)
        body = extruded([(0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0)], thick)
        plate = mesh_of(
            drawing.drilled(body, [(15.0, 15.0, 4.0), (80.0, 12.0, 5.0), (25.0, 46.0, 6.0)], thick)
        )
        surfaces.append(
            probed_surface(moved(quartered(quartered(plate)) if kind == "quartered" else plate, 3))
        )
    starts = [one.samples.representatives * one.samples.unit + one.samples.centre for one in surfaces]
    found = copy_by_surfaces(*surfaces, (starts[0], starts[1]))
    assert found is not None
    assert found.difference is not None
    assert found.difference.distance == pytest.approx(1.0, abs=0.03)
    sides = [[100.0, 60.0, 5.0], [100.0, 60.0, thickness]]
    assert np.abs(np.subtract(found.difference.sides, sides)).max() <= 0.01


def test_a_hexagon_of_another_thickness_is_a_variant_by_its_own_matches() -> None:
    """One side coincides from the start, and most probes are at the edges of the other."""
    outline = [(35.0 * math.cos(angle), 35.0 * math.sin(angle)) for angle in np.radians(range(0, 360, 60))]
    found = by_surfaces(*(mesh_of(extruded(outline, thickness)) for thickness in (5.0, 6.0)))
    assert found is not None
    assert found.difference is not None
    assert found.difference.distance == pytest.approx(1.0, abs=0.03)
    assert found.scale == pytest.approx(1.0, rel=1e-4)


def test_a_variant_says_where_it_differs_and_how_much() -> None:
    first, second = part("plate", Drawing(8, 0.05)), part("plate", Drawing(8, 0.05, change="hole"))
    found = judged(first, moved(second, 4))
    assert found is not None
    assert found.difference is not None
    here = found.difference
    depth, radius = Drawing(8, 0.05).draw(45, 70, 1), Drawing(8, 0.05).draw(3, 6, 3)
    centre = np.array([14.0, depth - 13.0])
    assert here.through_holes == (3, 4)
    assert np.abs(np.array(here.point)[:2] - centre).max() <= radius + 0.1
    assert np.abs(np.array(here.low)[:2] - (centre - radius)).max() <= 0.3
    assert np.abs(np.array(here.high)[:2] - (centre + radius)).max() <= 0.3
    thick = Drawing(8, 0.05).draw(4, 9, 2)
    assert 0.5 * min(radius, thick / 2) <= here.distance <= radius + 0.1
    volumes = [embedded(mesh).facts.volume for mesh in (first, second)]
    assert here.volume == pytest.approx(volumes[1] / volumes[0], rel=1e-4)
