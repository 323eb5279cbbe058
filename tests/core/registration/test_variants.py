"""Copies and variants of machine parts: likeness, scale, and where a variant differs."""

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.registration.probed_surface import probed_surface
from core.registration.rigid_copy import RigidCopy, copy_by_surfaces
from tests.soak.duplicates.copies import moved
from tests.soak.kinship.parts import Change, Drawing, Family, part

PIPELINE = Pipeline()


def judged(first: Mesh, second: Mesh) -> RigidCopy | None:
    """By what remains of both in an STL; a search for copies alone finds the same, but no variant."""
    first, second = (read_mesh(write_mesh(mesh, "stl"), "stl") for mesh in (first, second))
    one, other = PIPELINE.embed(first), PIPELINE.embed(second)
    pairs = PIPELINE.match(one, other).correspondence
    ends = one.positions[pairs[:, 0]].astype(float), other.positions[pairs[:, 1]].astype(float)
    surfaces = probed_surface(first), probed_surface(second)
    found = copy_by_surfaces(*surfaces, ends)
    is_copy = found is not None and found.difference is None
    assert copy_by_surfaces(*surfaces, ends, variants=False) == (found if is_copy else None)
    return found


@pytest.mark.parametrize("family", ["plate", "bracket", "flange", "gear", "shaft", "housing"])
def test_a_remeshed_copy_is_a_copy_and_its_scale_is_exact(family: Family) -> None:
    first, second = (part(family, Drawing(5, 0.05, phase)) for phase in (0.0, 0.37))
    found = judged(first, moved(second, 1, scale=25.4))
    assert found is not None
    assert found.difference is None
    assert not found.mirrored
    assert found.scale == pytest.approx(25.4, rel=1e-4)


@pytest.mark.parametrize("family", ["bracket", "housing"])
def test_a_part_with_two_hands_is_mirrored(family: Family) -> None:
    first, second = (part(family, Drawing(6, 0.05, phase)) for phase in (0.0, 0.37))
    found = judged(first, moved(second, 2, scale=1 / 3, mirrored=True))
    assert found is not None
    assert (found.mirrored, found.difference) == (True, None)
    assert found.scale == pytest.approx(1 / 3, rel=1e-4)


@pytest.mark.parametrize(
    ("family", "change"),
    [
        ("plate", "hole"),
        ("bracket", "moved"),
        ("flange", "larger"),
        ("gear", "fillet"),
        ("shaft", "longer"),
        ("housing", "larger"),
    ],
)
def test_a_part_with_a_change_is_a_variant(family: Family, change: Change) -> None:
    first, second = part(family, Drawing(7, 0.1)), part(family, Drawing(7, 0.1, change=change))
    found = judged(first, moved(second, 3, scale=2.0))
    assert found is not None
    assert found.difference is not None
    assert found.scale == pytest.approx(2.0, rel=1e-3)


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
    volumes = [PIPELINE.embed(mesh).facts.volume for mesh in (first, second)]
    assert here.volume == pytest.approx(volumes[1] / volumes[0], rel=1e-4)


def test_the_longer_plate_differs_at_its_end_by_a_millimetre() -> None:
    first, second = part("plate", Drawing(9, 0.05)), part("plate", Drawing(9, 0.05, change="longer"))
    found = judged(first, moved(second, 5))
    assert found is not None
    assert found.difference is not None
    assert found.difference.distance == pytest.approx(1.0, abs=0.02)
    assert found.difference.low[0] > 0.5 * Drawing(9, 0.05).draw(80, 140, 0)
