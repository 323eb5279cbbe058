"""Differences of variants in words, and of plates with holes by registration."""

import math
import re

import numpy as np
import pytest

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.search.local_difference import LocalDifference
from service.search.schemas import likeness_in_words
from tests.service.support import Running, query
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, extruded

SIDES = (60.0, 40.0, 6.0)
HOLE = LocalDifference(
    point=(10.0, 5.0, 3.0),
    low=(6.02, 1.01, -0.0004),
    high=(14.01, 8.99, 6.0),
    distance=3.0,
    sides=(SIDES, (60.001, 40.0, 6.0)),
    volume=0.9786,
    area=1.002,
    through_holes=(4, 3),
)


def words(**changes: object) -> str:
    return HOLE.model_copy(update=changes).text


def test_the_words_tell_holes_lengths_place_box_and_volume() -> None:
    assert words() == "3 through holes instead of 4, at (10, 5, 3), in a box of 8 × 8 × 6; 2.1 % less volume"
    assert words(through_holes=(0, 1)).startswith("1 through hole instead of none, at")
    assert words(through_holes=(1, 0)).startswith("no through holes instead of 1, at")
    moved = words(through_holes=(4, 4), volume=1.00001)
    assert moved == "surfaces up to 3 apart, at (10, 5, 3), in a box of 8 × 8 × 6; equal volume"
    changed = {"through_holes": (4, 4), "distance": 1.0, "sides": (SIDES, (61.0, 40.0, 5.4))}
    assert words(**changed).startswith("length 61 instead of 60, height 5.4 instead of 6, at (")
    # A hole of radius 3 hides neither a thinner plate nor a longer one.
    thinner, longer = words(sides=(SIDES, (60.0, 40.0, 5.0))), words(sides=(SIDES, (61.0, 40.0, 6.0)))
    assert thinner.startswith("3 through holes instead of 4, height 5 instead of 6, at (")
    assert longer.startswith("3 through holes instead of 4, length 61 instead of 60, at (")
    assert words(through_holes=None, volume=None).endswith(" × 6; 0.2 % more area")
    place = {"low": (0.0011, -0.002, 0.0), "high": (0.0021, 0.002, 0.0), "distance": 0.00123}
    assert "at (0.0016, 0, 0), in a box of 0.001 × 0.004 × 0;" in words(**place)


def test_the_reverse_of_a_difference_has_the_other_words() -> None:
    back = HOLE.reverse()
    assert (
        back.text == "4 through holes instead of 3, at (10, 5, 3), in a box of 8 × 8 × 6; 2.2 % more volume"
    )
    assert back.reverse().text == HOLE.text


def test_the_difference_follows_the_likeness_and_the_size() -> None:
    assert likeness_in_words("variant", 1.001, HOLE) == f"Variant: {HOLE.text}"
    larger = HOLE.model_copy(update={"scale": 1.5})
    assert (
        likeness_in_words("variant", 1.5, larger)
        == f"Variant, 1.5 times as large: at equal size: {HOLE.text}"
    )
    assert larger.reverse().scale == 1 / 1.5
    assert larger.reverse().text == f"at equal size: {HOLE.reverse().text}"


@pytest.mark.parametrize("scale", [0.9726, 0.9985, 1.0015, 1.029])
def test_lengths_of_another_size_are_told_as_such(scale: float) -> None:
    """Parts whose sizes differ by less than 3 % count as of one size, and lengths tell them apart."""
    assert HOLE.model_copy(update={"scale": scale}).text == f"at equal size: {HOLE.text}"


@pytest.mark.parametrize("scale", [0.9998, 1.0002])
def test_the_error_of_a_scale_is_no_other_size(scale: float) -> None:
    assert HOLE.model_copy(update={"scale": scale}).text == HOLE.text


LENGTH, DEPTH, THICK, RADIUS = 60.0, 40.0, 6.0, 4.0
HOLES = [(12.0, 10.0), (47.0, 12.0), (30.0, 28.0)]


def plate(holes: list[tuple[float, float]], length: float = LENGTH) -> Mesh:
    """Return a plate with a corner at the origin and holes along z."""
    drawing = Drawing(0, 0.02)
    corners = [(0.0, 0.0), (length, 0.0), (length, DEPTH), (0.0, DEPTH)]
    body = drawing.drilled(extruded(corners, THICK), [(x, y, RADIUS) for x, y in holes], THICK)
    made = body.to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3]), made.tri_verts.astype(np.int64))


def told(running: Running, first: Mesh, second: Mesh) -> str:
    """What a query with the first says of the second, which is stored turned and twice as large."""
    running.clear()
    running.store(write_mesh(moved(second, 3, scale=2.0), "stl"), "second.stl")
    (result,) = query(running.client, write_mesh(first, "stl"), "first.stl").json()["results"]
    assert result["likeness"] == "variant"
    assert result["difference"]["scale"] == result["scale"] == pytest.approx(2.0, abs=1e-4)
    begin, _, text = result["difference"]["text"].partition(": ")
    assert begin == "at equal size"
    return str(text)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", text)]


@pytest.mark.parametrize("more", [False, True])
def test_a_hole_more_or_less_is_told_where_it_is(shared: Running, more: bool) -> None:
    plates = plate(HOLES), plate([*HOLES, (10.0, 30.0)])
    text = told(shared, *(plates if more else plates[::-1]))
    assert text.startswith(f"{3 + more} through holes instead of {4 - more}, at (")
    x, y, z, *sides, percent = numbers(text.partition(" at ")[2])
    assert (x, y, z) == pytest.approx((10.0, 30.0, 0.5 * THICK), abs=0.2)
    assert sides == pytest.approx([2 * RADIUS, 2 * RADIUS, THICK], abs=0.3)
    area, hole = LENGTH * DEPTH, math.pi * RADIUS**2
    share = hole / (area - (3 if more else 4) * hole)
    assert percent == pytest.approx(100.0 * share, abs=0.06)
    assert ("less" if more else "more") in text


@pytest.mark.parametrize("seed", [0, 5])
def test_a_longer_plate_is_told_by_its_length_in_any_turn(shared: Running, seed: int) -> None:
    """The first plate lies along no axis of its file."""
    text = told(shared, moved(plate(HOLES), seed), plate(HOLES, LENGTH + 1.5))
    assert text.startswith("length 61.5 instead of 60, at (")
    area = LENGTH * DEPTH - 3 * math.pi * RADIUS**2
    assert numbers(text)[-1] == pytest.approx(100.0 * 1.5 * DEPTH / area, abs=0.06)


def test_a_moved_hole_is_told_by_the_largest_distance(shared: Running) -> None:
    text = told(shared, plate(HOLES), plate([*HOLES[:2], (30.0, 25.0)]))
    assert text.startswith("surfaces up to ")
    assert text.endswith("; equal volume")
    _, x, y, z, *_ = numbers(text)
    # Between both holes.
    assert (x, y, z) == pytest.approx((30.0, 26.5, 0.5 * THICK), abs=0.3)
