"""The groups of near-identical shapes."""

import pytest
from playwright.sync_api import expect

from core.gallery import make_shape
from core.io import write_mesh
from tests.service.support import Running
from tests.soak.browser.support import Visit, choose
from tests.soak.browser.test_everybody import serious
from tests.soak.browser.test_map import PHONE
from tests.studies.copies import moved


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_a_group_is_shown_and_a_copy_deleted_and_restored(visit: Visit, service: Running) -> None:
    service.store(write_mesh(moved(make_shape("fish", 0), 1, scale=2.0), "ply"), "twice.ply", tags="copy")
    page = visit.open("duplicates")
    groups, status = page.locator("#duplicates > li"), page.locator("#duplicates-status")
    expect(status).to_have_text("1 group of duplicates among 7 shapes.")
    expect(groups).to_have_count(1)
    expect(groups.locator(".name")).to_have_text(["fish-0.ply", "twice.ply"])
    expect(groups.locator(".likeness")).to_have_text(["Stored first", "Same part, 2 times as large"])
    expect(groups.locator("img").last).to_have_js_property("naturalWidth", 256)
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= page.evaluate("innerWidth")
    choose(page, "twice.ply", "Delete")
    expect(page.locator("#undo")).to_contain_text("twice.ply was deleted.")
    expect(status).to_have_text("No duplicates among 6 shapes.")
    page.get_by_role("button", name="Undo: restore twice.ply").click()
    expect(groups).to_have_count(1)
    page.fill("#duplicates-tags", "glasses")
    page.keyboard.press("Enter")
    expect(status).to_have_text("No duplicates among 3 shapes.")
    assert "view=duplicates&tag=glasses" in page.url
