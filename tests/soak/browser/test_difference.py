"""Where two shapes differ, on the page: a missing leg, one hole more, a bent leg; painted and laid over."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.dense.solids import bent_chair, chair, plate
from tests.core.shapes import scaled, turned
from tests.service.support import Running
from tests.soak.browser.support import Visit, drawn, file_in, next_frame, paint, pictures, settled
from tests.studies.machine_parts import Drawing
from tests.studies.machine_parts import part as machine_part

HOLES = [(4, 4), (22, 12)]


def blue_and_orange(shown: np.ndarray) -> tuple[int, int]:
    """Pixels of the colour of places without a partner, and of the scale from orange on."""
    red, green, blue = np.moveaxis(shown, 2, 0)
    without = (blue - red > 60) & (blue - green > 40)
    return int(without.sum()), int(((red - blue > 50) & (red - green > 25)).sum())


@pytest.fixture
def searched(visit: Visit, running: Running, tmp_path: Path) -> Callable[[Mesh, Mesh], Page]:
    """Store one shape, and search with another."""

    def search(query: Mesh, stored: Mesh) -> Page:
        running.clear()
        running.store(write_mesh(stored, "ply"), "stored.ply")
        page = visit.open()
        page.set_input_files("#find-file", file_in(tmp_path, write_mesh(query, "ply")))
        drawn(page, 2)
        assert page.is_hidden("#legend")
        return page

    return search


@pytest.fixture
def asked(searched: Callable[[Mesh, Mesh], Page]) -> Callable[[Mesh, Mesh], Page]:
    """Colour both by their difference, too."""

    def ask(query: Mesh, stored: Mesh) -> Page:
        page = searched(query, stored)
        paint(page, "difference")
        return page

    return ask


def told(page: Page) -> float:
    """The largest distance that a result's card names."""
    text = page.inner_text("#cards .difference")
    found = re.search(r"Brown: (\S+) in the unit of the query", text)
    assert found is not None, text
    return float(found[1])


def test_a_chair_without_a_leg(asked: Callable[[Mesh, Mesh], Page]) -> None:
    page = asked(chair(3), turned(chair(4), 3))
    (_, query), (_, result) = map(blue_and_orange, pictures(page))
    assert query < 30
    assert result > 300
    # The far edge of the leg's foot is 0.9 from the next leg, and 1 from the seat.
    assert told(page) == pytest.approx(0.9, rel=0.02)
    assert "Neither a copy nor a variant" in page.inner_text("#cards .difference")
    assert page.is_visible("#legend")
    assert "stored.ply" in page.inner_text("#legend")
    paint(page, "correspondence")
    assert page.is_hidden("#legend")
    expect(page.locator("#cards .difference")).to_have_text("")


def test_a_plate_with_one_hole_more(asked: Callable[[Mesh, Mesh], Page]) -> None:
    page = asked(plate(HOLES), turned(plate([*HOLES, (14, 8)]), 5))
    query, _ = pictures(page)
    # All else is grey.
    assert (np.ptp(query, axis=2) > 40).sum() > 40
    # The middle of the hole of 0.3 by 0.3.
    assert told(page) == pytest.approx(0.15, rel=0.02)


def test_a_hole_in_the_middle_of_large_triangles(asked: Callable[[Mesh, Mesh], Page]) -> None:
    plain, changed = (machine_part("plate", Drawing(3, 0.02, change=change)) for change in (None, "hole"))
    assert len(plain.faces) < 1000
    page = asked(plain, turned(changed, 6))
    query, _ = pictures(page)
    assert blue_and_orange(query)[1] > 30
    assert told(page) == pytest.approx(Drawing(3, 0.02).draw(3, 6, 3), rel=0.02)


def test_a_bent_leg(asked: Callable[[Mesh, Mesh], Page]) -> None:
    for shown in pictures(asked(chair(), bent_chair())):
        assert blue_and_orange(shown)[1] > 100
    page = asked(chair(), scaled(turned(chair(), 2), 25.4))
    assert sum(sum(blue_and_orange(shown)) for shown in pictures(page)) < 30
    text = "No difference beyond the errors of the meshes, at equal size"
    expect(page.locator("#cards .difference")).to_have_text(text)


def alike(one: np.ndarray, other: np.ndarray) -> float:
    """The share of the pixels that differ in no colour by more than rounding and the edges of triangles."""
    return float((np.abs(one - other).max(axis=2) <= 12.0).mean())


def test_the_two_are_laid_over_each_other_in_the_frame_of_the_query(
    asked: Callable[[Mesh, Mesh], Page],
) -> None:
    page = asked(chair(3), scaled(turned(chair(4), 3), 25.4))
    query, painted = pictures(page)
    assert page.is_hidden("#blend")
    page.select_option("#difference-as", "overlay")
    page.fill("#blend", "0")
    next_frame(page)
    assert alike(pictures(page)[1], query) > 0.99 > alike(painted, query)
    page.fill("#blend", "1")
    next_frame(page)
    assert alike(pictures(page)[1], painted) > 0.99
    page.fill("#blend", "0.5")
    next_frame(page)
    half = pictures(page)[1]
    # What both have stays opaque; the leg of one is half as strong.
    assert alike(half, 0.5 * (query + painted)) > 0.98
    page.select_option("#difference-as", "side")
    next_frame(page)
    assert page.is_hidden("#blend")
    assert sum(blue_and_orange(shown)[1] for shown in pictures(page)) < 30
    page.select_option("#difference-as", "painted")
    next_frame(page)
    assert alike(pictures(page)[1], painted) > 0.99


def test_a_bar_moves_while_the_difference_is_computed(searched: Callable[[Mesh, Mesh], Page]) -> None:
    page = searched(chair(3), chair(4))
    page.uncheck("#points")
    kept: list[Route] = []

    def keep(route: Route) -> None:
        kept.append(route)

    page.route("**/compare?*", keep)
    page.select_option("#paint", "difference")
    expect(page.locator("#cards progress")).to_have_count(1)
    assert all(sum(blue_and_orange(shown)) < 30 for shown in pictures(page))
    for route in kept:
        route.continue_()
    settled(page)
    assert page.locator("#cards progress").count() == 0
    assert blue_and_orange(pictures(page)[1])[1] > 300
