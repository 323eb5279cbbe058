"""The stretch of maps whose local lengths are known."""

import numpy as np
import pytest

from core import Mesh
from core.dense.dense_correspondence import stretch
from tests.core.shapes import rectangle, scaled, turned


def test_a_sheet_of_which_one_half_is_drawn_out():
    sheet = rectangle(2.0, 1.0, 40, 20)
    points = sheet.vertices.copy()
    points[:, 0] += np.maximum(points[:, 0] - 1.0, 0.0)
    found = stretch(sheet, turned(Mesh(points, sheet.faces), 2), np.arange(len(points)))
    left, right = sheet.vertices[:, 0] < 0.7, sheet.vertices[:, 0] > 1.3
    assert np.ptp(np.log(found[left])) < 0.01
    # Twice as long in one of two directions.
    assert np.median(found[right]) / np.median(found[left]) == pytest.approx(np.sqrt(2.5), rel=0.1)


def test_size_is_no_stretch():
    sheet = rectangle(2.0, 1.0, 12, 6)
    np.testing.assert_allclose(stretch(sheet, scaled(sheet, 9.0), np.arange(len(sheet.vertices))), 1.0)


def test_a_neighbourhood_that_shrinks_to_a_point():
    sheet = rectangle(1.0, 1.0, 8, 8)
    there = np.arange(len(sheet.vertices))
    there[: len(there) // 3] = 0
    found = stretch(sheet, sheet, there)
    assert np.isfinite(found).all()
    assert found.min() < 0.1
