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
from tests.soak.browser.support import Visit, drawn, picture, settled

HOLES = [(4, 4), (22, 12)]


def bent() -> Mesh:
    """A chair with one leg bent outwards."""
    whole = chair()
    points = whole.vertices.copy()
    leg = (points[:, 0] > 0.95) & (points[:, 1] > 0.85) & (points[:, 2] < 0.95)
    points[leg, 0] += 0.6 * (1.0 - points[leg, 2])
    return Mesh(points, whole.faces)


def blue(shown: np.ndarray) -> int:
    """Pixels of the colour of places without a partner."""
    red, green, blue = np.moveaxis(shown, 2, 0)
    return int(((blue - red > 60) & (blue - green > 40)).sum())


def orange(shown: np.ndarray) -> int:
    """Pixels of the scale from orange on."""
    red, green, blue = np.moveaxis(shown, 2, 0)
    return int(((red - blue > 50) & (red - green > 25)).sum())


@pytest.fixture
def asked(visit: Visit, running: Running, tmp_path: Path) -> Callable[[Mesh, Mesh], Page]:
    """Store one shape, search with another, and colour both by their difference."""

    def ask(query: Mesh, stored: Mesh) -> Page:
        running.clear()
        running.store(write_mesh(stored, "ply"), "stored.ply")
        path = tmp_path / "query.ply"
        path.write_bytes(write_mesh(query, "ply"))
        page = visit.open()
        page.set_input_files("#find-file", path)
        drawn(page, 2)
        assert page.is_hidden("#legend")
        page.select_option("#paint", "difference")
        settled(page)
        return page

    return ask


def shown_on(page: Page, folder: Path) -> list[np.ndarray]:
    """The pictures of the query and of the result."""
    return [picture(page.locator("#cards canvas").nth(i), folder) for i in range(2)]


def test_a_chair_without_a_leg(asked: Callable[[Mesh, Mesh], Page], tmp_path: Path) -> None:
    page = asked(chair(3), chair(4))
    query, result = shown_on(page, tmp_path)
    assert blue(result) > 300
    assert blue(query) < 30
    note = page.inner_text("#cards .difference")
    assert "correspond to none" in note
    assert page.is_visible("#legend")
    assert "stored.ply" in page.inner_text("#legend")
    page.select_option("#paint", "correspondence")
    settled(page)
    assert page.is_hidden("#legend")
    expect(page.locator("#cards .difference")).to_have_text("")


def test_a_plate_with_one_hole_more(asked: Callable[[Mesh, Mesh], Page], tmp_path: Path) -> None:
    page = asked(plate(HOLES), plate([*HOLES, (14, 8)]))
    query, _ = shown_on(page, tmp_path)
    # All else is grey.
    assert (np.ptp(query, axis=2) > 40).sum() > 40
    # The plate's vertices in the hole of 0.3 by 0.3 are 0.1 from its walls.
    told = re.match(r"Brown: (\S+) in the units", page.inner_text("#cards .difference"))
    assert told is not None
    assert 0.095 < float(told[1]) < 0.3


def test_a_bent_leg(asked: Callable[[Mesh, Mesh], Page], tmp_path: Path) -> None:
    query, result = shown_on(asked(chair(), bent()), tmp_path)
    for each in (query, result):
        assert orange(each) > 100
    same, other = shown_on(asked(chair(), turned(chair(), 2)), tmp_path)
    assert orange(same) + blue(same) + orange(other) + blue(other) < 30
