"""The likeness of two shapes by its thresholds."""

from typing import get_args

import numpy as np
import pytest

from core.ranking.isometry import distance_of_steps
from core.ranking.likeness import (
    NEAR_ISOMETRIC,
    POSE_CC,
    SIMILAR,
    Copy,
    Likeness,
    least_bend,
    likeness,
    may_be_pose,
)


@pytest.mark.parametrize(("scale", "told"), [(1.0, "same"), (0.98, "same"), (1.5, "scaled"), (0.3, "scaled")])
def test_a_rigid_copy_is_one_whatever_its_scores(scale: float, told: Likeness) -> None:
    assert likeness(probability=0.0, scale=scale, pose=True) == told


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_copy_of_the_mirror_image_is_mirrored_at_any_size(scale: float) -> None:
    assert likeness(probability=1.0, scale=scale, mirrored=True) == "mirrored"


def test_each_threshold_is_the_least_or_the_largest_value_of_its_likeness() -> None:
    assert may_be_pose(NEAR_ISOMETRIC, POSE_CC)
    assert not may_be_pose(np.nextafter(NEAR_ISOMETRIC, 1.0), POSE_CC)
    assert not may_be_pose(0.0, np.nextafter(POSE_CC, 0.0))
    assert likeness(probability=0.0, pose=True) == "pose"
    assert likeness(probability=SIMILAR) == "similar"
    assert likeness(probability=np.nextafter(SIMILAR, 0.0)) == "weak"


def test_a_pose_bends_more_the_farther_it_is_from_isometric() -> None:
    assert least_bend(0.0) == pytest.approx(0.055)
    assert least_bend(0.05) == pytest.approx(0.135)
    assert least_bend(np.inf) == least_bend(NEAR_ISOMETRIC)


def test_a_common_factor_and_the_volume_count_in_the_isometry_distance() -> None:
    alternating = 0.01 * np.array([1.0, -1.0] * 15)
    assert distance_of_steps(alternating, 0.0) == pytest.approx(0.01 * 30**0.5)
    assert distance_of_steps(np.full(30, 0.01), 0.0) == pytest.approx(0.01 * 150**0.5)
    assert distance_of_steps(np.zeros(30), -0.03) == pytest.approx(0.03 * 0.5**0.5)


def test_the_likenesses_of_copies_are_likenesses() -> None:
    assert set(get_args(Copy)) < set(get_args(Likeness))
