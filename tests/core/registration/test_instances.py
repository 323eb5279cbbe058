"""Instances of a part in plates made by code."""

import pytest
from manifold3d import Manifold

from core.descriptors.pieces import pieces
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.registration.instances import Instances, instances, possible_instances
from tests.core.shapes import joined, shifted
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part
from tests.studies.print_plates import mirror_image, plate

BRACKET = part("bracket", Drawing(5, 0.1))
OTHERS = {
    "another bracket": part("bracket", Drawing(6, 0.1)),
    "one hole more": part("bracket", Drawing(5, 0.1, change="hole")),
    "a longer one": part("bracket", Drawing(5, 0.1, change="longer")),
    "another size": moved(BRACKET, 0, scale=1.05),
    "a plate": part("plate", Drawing(1, 0.1)),
}


def rows_of(mesh):
    cleaned = clean(mesh)
    return pieces(cleaned.mesh, cleaned.labels)


def test_a_plate_has_each_copy_however_it_is_turned():
    tumbled = joined(*(shifted(moved(BRACKET, seed), (300.0 * seed, 0, 0)) for seed in range(3)))
    for whole, count in ((plate([BRACKET] * 6), 6), (tumbled, 3)):
        assert possible_instances(rows_of(BRACKET), rows_of(whole)) == count
        assert possible_instances(rows_of(whole), rows_of(BRACKET)) == count
        assert instances(BRACKET, whole) == Instances(count, 0)


def test_pieces_of_another_tessellation_are_instances():
    finer = part("bracket", Drawing(5, 0.05, 0.4))
    assert instances(BRACKET, plate([finer] * 3)) == Instances(3, 0)


def test_mirror_images_are_counted_apart():
    image = mirror_image(BRACKET)
    assert instances(BRACKET, plate([BRACKET, image, BRACKET, image, image])) == Instances(2, 3)


def test_a_part_that_is_its_own_mirror_image_has_no_mirrored_instances():
    symmetric = part("flange", Drawing(3, 0.2))
    assert instances(symmetric, plate([symmetric, mirror_image(symmetric)])) == Instances(2, 0)


@pytest.mark.parametrize("name", OTHERS)
def test_a_plate_of_unlike_parts_has_none(name):
    whole = plate([OTHERS[name]] * 3)
    # Lengths do not tell a part that is 1 mm longer: registration does.
    assert possible_instances(rows_of(BRACKET), rows_of(whole)) == 3 * (name == "a longer one")
    assert instances(BRACKET, whole) == Instances(0, 0)


def test_each_part_of_a_mixed_plate_is_counted():
    other = OTHERS["a plate"]
    whole = plate([BRACKET, other, other, BRACKET, other])
    assert rows_of(whole)[:, -1].tolist() == [3, 2]
    assert instances(BRACKET, whole) == Instances(2, 0)
    assert instances(other, whole) == Instances(3, 0)


def test_one_of_the_two_has_one_piece():
    pair = plate([BRACKET] * 2)
    assert possible_instances(rows_of(pair), rows_of(plate([BRACKET] * 4))) == 0
    assert possible_instances(rows_of(BRACKET), rows_of(BRACKET)) == 0


def bar(*, across):
    """A bar with a peg on top at each end, on one side or on two sides."""
    pegs = [Manifold.cube((3.0, 3.0, 3.0)).translate((x, y, 9.0)) for x, y in ((5, 5), (52, across))]
    mesh = sum(pegs, Manifold.cube((60.0, 40.0, 10.0))).to_mesh64()
    return Mesh(mesh.vert_properties, mesh.tri_verts)


def test_registration_tells_pieces_of_nearly_equal_lengths_apart():
    one, other = bar(across=5), bar(across=32)
    whole = plate([other, one, other])
    assert possible_instances(rows_of(one), rows_of(whole)) == 3
    assert instances(one, whole) == Instances(1, 0)
