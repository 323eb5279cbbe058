"""Parts found among wholes, and one-sided distances against a plain reference."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from core.gallery import make_shape
from core.gallery.frames import rotation
from core.mesh import Mesh
from core.partial import AT_ONCE, MISSING, Part, part_distances, parts, patches
from core.perturbation import cut_part, subdivide

CLASSES = ("bird", "cup", "octopus", "person", "plane", "quadruped")
WHOLES = {label: make_shape(label, 0) for label in CLASSES}
KNOWN = [patches(mesh) for mesh in WHOLES.values()]


def moved(mesh: Mesh, scale: float) -> Mesh:
    return Mesh(scale * mesh.vertices @ rotation("x", 70.0).T + [1.0, -2.0, 3.0], mesh.faces)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
def test_a_part_is_found_wherever_it_lies_and_in_any_unit(share: float) -> None:
    for place, mesh in enumerate(WHOLES.values()):
        part = subdivide(moved(cut_part(mesh, share, place), 0.01), 0.3, 1)
        assert part_distances(parts(part), KNOWN).argmin() == place


def test_motion_and_unit_change_nothing() -> None:
    mesh = WHOLES["octopus"]
    assert np.abs(patches(moved(mesh, 250.0)) - patches(mesh)).mean() < 1e-4


def test_distances_are_those_of_a_search_over_all_pairs() -> None:
    draws = np.random.default_rng(0)
    wholes = [draws.random((7, 5)).astype(np.float32) for _ in range(AT_ONCE + 3)]
    asked = []
    for count in (4, 6):
        weights = draws.random(count)
        asked.append(Part(draws.random((count, 5)).astype(np.float32), weights / weights.sum()))
    wanted = [
        min(
            sum(
                weight * min(((patch - other) ** 2).sum() for other in whole)
                for weight, patch in zip(part.weights, part.patches, strict=True)
            )
            for part in asked
        )
        for whole in wholes
    ]
    assert_allclose(part_distances(asked, wholes), wanted, rtol=1e-5)


def test_points_at_the_rim_count_little() -> None:
    whole, cut = parts(WHOLES["person"]), parts(cut_part(WHOLES["person"], 0.4, 0))
    assert len(whole) == len(cut) == len(MISSING)
    for part in whole:
        assert_allclose(part.weights, 1.0 / len(part.weights))
    for part in cut:
        assert part.weights.sum() == pytest.approx(1.0)
        assert part.weights.max() > 10.0 * part.weights.min()


def test_no_patch_has_more_area_than_points_can_tell() -> None:
    for known in KNOWN:
        assert known.dtype == np.float32
        assert np.isfinite(known).all()
        assert (known >= 0.0).all()
