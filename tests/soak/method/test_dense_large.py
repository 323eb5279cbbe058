"""The dense correspondence of a mesh of two million faces."""

import numpy as np

from core import Mesh, Pipeline
from tests.core.dense.solids import SIDE, chair
from tests.core.shapes import scaled, subdivided, turned


def test_two_million_faces_against_two_thousand() -> None:
    coarse = chair()
    large: Mesh = coarse
    while len(large.faces) < 2_000_000:
        large = subdivided(large)
    found, back = Pipeline().correspond_both(large, scaled(turned(coarse, 3), 12.0))
    assert found.simplified
    assert back.simplified
    assert found.vertices.shape == (len(large.vertices),)
    gaps = np.linalg.norm(coarse.vertices[found.vertices] - large.vertices, axis=1)
    assert np.quantile(gaps, 0.99) < 2 * SIDE
    assert np.linalg.norm(large.vertices[back.vertices] - coarse.vertices, axis=1).max() < 2 * SIDE
    assert found.displacement is not None
    assert found.displacement.max() < 0.05
