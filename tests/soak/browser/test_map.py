"""The map of the stored shapes."""

from itertools import combinations, pairwise
from math import hypot
from statistics import mean

import pytest
from playwright.sync_api import expect

from tests.service.support import Running
from tests.soak.browser.support import Visit, drawn
from tests.soak.browser.test_everybody import serious

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_the_map_shows_similar_shapes_near_each_other(visit: Visit, service: Running) -> None:
    page = visit.open("map")
    links = page.locator("#map a")
    expect(links).to_have_count(6)
    expect(page.locator("#map-status")).to_contain_text("6 shapes")
    boxes = {}
    for link in links.all():
        expect(link.locator("img")).to_have_js_property("naturalWidth", 128)
        box = link.bounding_box()
        assert box is not None
        boxes[link.get_attribute("title")] = (box["x"], box["y"], box["width"])
    # Pictures do not overlap.
    places = sorted((x, y) for x, y, _ in boxes.values())
    width = boxes["fish-0.ply"][2]
    assert all(b[0] - a[0] > width - 1 or abs(b[1] - a[1]) > width - 1 for a, b in pairwise(places))
    apart: dict[bool, list[float]] = {True: [], False: []}
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        apart[one[:4] == other[:4]].append(hypot(a[0] - b[0], a[1] - b[1]))
    assert mean(apart[True]) < 0.8 * mean(apart[False]), boxes
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= page.evaluate("innerWidth")
    page.get_by_role("button", name="Zoom out").click()
    assert page.locator("#map a").first.bounding_box()["width"] < width
    page.get_by_role("button", name="Reset view").click()
    assert page.locator("#map a").first.bounding_box()["width"] == pytest.approx(width, abs=1)
    page.fill("#map-tags", "fish")
    page.keyboard.press("Enter")
    expect(links).to_have_count(3)
    assert "view=map&tag=fish" in page.url


def test_the_map_by_keyboard(visit: Visit, service: Running) -> None:
    page = visit.open("map")
    expect(page.locator("#map a")).to_have_count(6)
    page.locator("#map a[tabindex='0']").focus()
    seen = set()
    for key in ["ArrowRight"] * 4 + ["ArrowLeft"] * 4 + ["ArrowUp"] * 4 + ["ArrowDown"] * 4:
        page.keyboard.press(key)
        seen.add(page.evaluate("document.activeElement.title"))
        assert page.locator("#map a[tabindex='0']").count() == 1
    assert len(seen) >= 3
    name = page.evaluate("document.activeElement.title")
    page.keyboard.press("Enter")
    expect(page.locator("#find-name")).to_have_text(name)
    drawn(page, 4)
    page.go_back()
    expect(page.locator("#map a")).to_have_count(6)
