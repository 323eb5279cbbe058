"""The colouring that shows where two shapes differ: a missing leg, one hole more, a bent leg."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.dense.solids import chair, plate
from tests.core.shapes import turned
from tests.service.support import Running
from tests.soak.browser.support import Visit, drawn, file_in, paint, pictures

HOLES = [(4, 4), (22, 12)]


def bent() -> Mesh:
    """A chair with one leg bent outwards."""
    whole = chair()
    points = whole.vertices.copy()
    leg = (points[:, 0] > 0.95) & (points[:, 1] > 0.85) & (points[:, 2] < 0.95)
    points[leg, 0] += 0.6 * (1.0 - points[leg, 2])
    return Mesh(points, whole.faces)


def blue_and_orange(shown: np.ndarray) -> tuple[int, int]:
    """Pixels of the colour of places without a partner, and of the scale from orange on."""
    red, green, blue = np.moveaxis(shown, 2, 0)
    without = (blue - red > 60) & (blue - green > 40)
    return int(without.sum()), int(((red - blue > 50) & (red - green > 25)).sum())


@pytest.fixture
def asked(visit: Visit, running: Running, tmp_path: Path) -> Callable[[Mesh, Mesh], Page]:
    """Store one shape, search with another, and colour both by their difference."""

    def ask(query: Mesh, stored: Mesh) -> Page:
        running.clear()
        running.store(write_mesh(stored, "ply"), "stored.ply")
        page = visit.open()
        page.set_input_files("#find-file", file_in(tmp_path, write_mesh(query, "ply")))
        drawn(page, 2)
        assert page.is_hidden("#legend")
        paint(page, "difference")
        return page

    return ask


def test_a_chair_without_a_leg(asked: Callable[[Mesh, Mesh], Page]) -> None:
    page = asked(chair(3), chair(4))
    (query, _), (result, _) = map(blue_and_orange, pictures(page))
    assert query < 30
    assert result > 300
    assert "correspond to none" in page.inner_text("#cards .difference")
    assert page.is_visible("#legend")
    assert "stored.ply" in page.inner_text("#legend")
    paint(page, "correspondence")
    assert page.is_hidden("#legend")
    expect(page.locator("#cards .difference")).to_have_text("")


def test_a_plate_with_one_hole_more(asked: Callable[[Mesh, Mesh], Page]) -> None:
    page = asked(plate(HOLES), plate([*HOLES, (14, 8)]))
    query, _ = pictures(page)
    # All else is grey.
    assert (np.ptp(query, axis=2) > 40).sum() > 40
    # The plate's vertices in the hole of 0.3 by 0.3 are 0.1 from its walls.
    told = re.match(r"Brown: (\S+) in the unit of the shape", page.inner_text("#cards .difference"))
    assert told is not None
    assert 0.095 < float(told[1]) < 0.3


def test_a_bent_leg(asked: Callable[[Mesh, Mesh], Page]) -> None:
    for shown in pictures(asked(chair(), bent())):
        assert blue_and_orange(shown)[1] > 100
    same = pictures(asked(chair(), turned(chair(), 2)))
    assert sum(sum(blue_and_orange(shown)) for shown in same) < 30
