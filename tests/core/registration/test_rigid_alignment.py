"""Alignments of parts that are neither copies nor variants, and of bodies that bend."""

import numpy as np
import pytest

from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.ranking.isometry import isometry_distance
from core.ranking.likeness import least_bend
from core.registration.probed_surface import probed_surface
from core.registration.rigid_alignment import rigid_alignment
from core.registration.similarity import Similarity
from tests.core.dense.solids import bent_chair, chair
from tests.core.shapes import scaled, turned
from tests.gallery import make_body

PIPELINE = Pipeline()


def aligned(first: Mesh, second: Mesh) -> Similarity | None:
    one, other = PIPELINE.embed(first), PIPELINE.embed(second)
    ends = PIPELINE.match(one, other).points(one, other)
    bent = least_bend(isometry_distance(one, other))
    return rigid_alignment(probed_surface(first), probed_surface(second), ends, bent)


@pytest.mark.parametrize("size", [1.0, 25.4])
@pytest.mark.parametrize("other", [chair(4), bent_chair()], ids=["leg more", "bent leg"])
def test_a_chair_is_laid_on_one_with_another_leg(other: Mesh, size: float) -> None:
    first = chair(3) if len(other.vertices) == len(chair(4).vertices) else chair(4)
    found = aligned(first, scaled(turned(other, 3), size))
    assert found is not None
    assert found.scale == pytest.approx(size, rel=1e-3)
    # All but the leg is in its place; a chair is its own mirror image.
    there, expected = found.apply(chair(3).vertices), scaled(turned(chair(3), 3), size).vertices
    low, high = expected.min(axis=0), expected.max(axis=0)
    assert np.abs(np.array([there.min(axis=0) - low, there.max(axis=0) - high])).max() < 0.01 * size


@pytest.mark.parametrize("name", ["hand", "teddy", "octopus"])
def test_bodies_that_bend_have_no_alignment(name: str) -> None:
    body = make_body(name)
    assert aligned(body.posed(0), body.posed(1)) is None
