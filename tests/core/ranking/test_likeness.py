"""The likeness of two shapes by its thresholds."""

from typing import get_args

import numpy as np
import pytest

from core.ranking.likeness import BENT, NEAR_ISOMETRIC, POSE_CC, SIMILAR, Copy, Likeness, likeness

FAR = 10.0 * NEAR_ISOMETRIC


@pytest.mark.parametrize(("scale", "told"), [(1.0, "same"), (0.98, "same"), (1.5, "scaled"), (0.3, "scaled")])
def test_a_rigid_copy_is_one_whatever_its_scores(scale: float, told: Likeness) -> None:
    assert likeness(spectral=FAR, cc=0.0, probability=0.0, scale=scale) == told


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_copy_of_the_mirror_image_is_mirrored_at_any_size(scale: float) -> None:
    assert likeness(spectral=0.0, cc=1.0, probability=1.0, scale=scale, mirrored=True) == "mirrored"


def test_each_threshold_is_the_least_or_the_largest_value_of_its_likeness() -> None:
    def told(spectral: float, cc: float, probability: float, bend: float = BENT) -> Likeness:
        return likeness(spectral=spectral, cc=cc, probability=probability, scale=None, bend=bend)

    assert told(NEAR_ISOMETRIC, POSE_CC, 0.0) == "pose"
    assert told(0.0, 1.0, SIMILAR, np.nextafter(BENT, 0.0)) == "similar"
    assert told(np.nextafter(NEAR_ISOMETRIC, 1.0), POSE_CC, SIMILAR) == "similar"
    assert told(0.0, np.nextafter(POSE_CC, 0.0), SIMILAR) == "similar"
    assert told(FAR, 1.0, np.nextafter(SIMILAR, 0.0)) == "weak"
    assert told(0.0, 0.0, 0.0) == "weak"


def test_the_likenesses_of_copies_are_likenesses() -> None:
    assert set(get_args(Copy)) < set(get_args(Likeness))
