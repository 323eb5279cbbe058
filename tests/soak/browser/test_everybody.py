"""The page for everybody: by keyboard, on a phone, by screen reader, on a slow line."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.service.support import Running
from tests.soak.browser.support import PHONE, Visit, box_of, drawn, file_in, next_frame, serious, stored


def tab_to(page: Page, selector: str, most: int = 80) -> None:
    """Press Tab until an element has the focus."""
    for _ in range(most):
        page.keyboard.press("Tab")
        if page.evaluate("selector => document.activeElement.matches(selector)", selector):
            return
    raise AssertionError(f"{selector} is not reached with Tab")


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, {"color_scheme": "light"}], indirect=True)
def test_axe_finds_no_serious_problem(visit: Visit, tmp_path: Path) -> None:
    page = visit.open()
    assert serious(page) == []
    visit.find(file_in(tmp_path))
    assert serious(page) == []
    visit.open("upload")
    assert serious(page) == []
    visit.open("browse")
    assert serious(page) == []
    page.locator("#gallery-filters summary").click()
    page.get_by_role("button", name="Menu of fish-0.ply").click()
    assert serious(page) == []
    page.locator("#card-menu").get_by_role("button", name="Delete").click()
    page.locator("#deleted summary").click()
    page.wait_for_selector("#deleted-list li")
    assert serious(page) == []
    page.get_by_role("button", name="Delete fish-0.ply for good").first.click()
    assert serious(page) == []
    page.keyboard.press("Escape")
    page.get_by_role("link", name="fish-1.ply", exact=True).click()
    page.wait_for_selector("#cards canvas[data-drawn]")
    assert serious(page) == []


def test_everything_by_keyboard(visit: Visit) -> None:
    page = visit.open()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    tab_to(page, "#find-filters summary")
    page.keyboard.press("Enter")
    tab_to(page, "#find-tags")
    page.keyboard.type("fish")
    tab_to(page, "[aria-label='Find similar to fish-0.ply']")
    page.keyboard.press("Enter")
    drawn(page, 3)
    # The focus goes to what was found.
    assert page.evaluate("document.activeElement.id") == "results"
    tab_to(page, "#next-point")
    page.keyboard.press("Space")
    first = page.inner_text("#point-status")
    page.keyboard.press("Space")
    assert "↔" in first
    assert page.inner_text("#point-status") != first
    tab_to(page, "#cards canvas")
    before = page.evaluate("document.activeElement.toDataURL()")
    page.keyboard.press("ArrowRight")
    next_frame(page)
    assert page.evaluate("document.activeElement.toDataURL()") != before
    tab_to(page, "#views a[data-view=browse]")
    page.keyboard.press("Enter")
    page.wait_for_selector("#gallery li")
    tab_to(page, "[aria-label='Menu of fish-0.ply']")
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.ariaLabel") == "Menu of fish-0.ply"
    page.keyboard.press("Enter")
    for _ in range(3):
        page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Delete"
    page.keyboard.press("Enter")
    expect(page.locator("#gallery li")).to_have_count(5)
    # Enter again takes it back.
    assert page.evaluate("document.activeElement.ariaLabel") == "Undo: restore fish-0.ply"
    page.keyboard.press("Enter")
    expect(page.locator("#gallery li")).to_have_count(6)
    assert page.evaluate("document.activeElement.id") == "undo"


@pytest.mark.parametrize("visit", [PHONE], indirect=True)
def test_a_phone_shows_large_pictures_and_buttons(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    for canvas in page.locator("#cards canvas").all():
        box = box_of(canvas)
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 360
        assert box["width"] > 250
    assert serious(page) == []
    visit.open("browse")
    # Fingers need some room.
    assert all(box_of(button)["height"] >= 36 for button in page.locator("#gallery .buttons > *").all())
    assert serious(page) == []


@pytest.mark.parametrize(
    "visit", [{"viewport": {"width": 1280, "height": 800}, "color_scheme": "dark"}], indirect=True
)
def test_the_results_of_a_query_are_on_the_first_screen(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    assert page.evaluate("scrollY") == 0
    # The pictures and the words below them, of the query and of all three results.
    for shown in page.locator("#cards canvas, #cards .likeness").all():
        box = box_of(shown)
        assert box["y"] + box["height"] <= 800


@pytest.mark.parametrize("visit", [{**PHONE, "viewport": {"width": 390, "height": 844}}], indirect=True)
def test_a_phone_has_one_line_of_header(visit: Visit, service: Running) -> None:
    service.client.put("/collections/castings")
    page = visit.open()
    assert box_of(page.locator("header"))["height"] <= 60
    rows = {round(box_of(link)["y"]) for link in page.locator("#views a").all()}
    assert len(rows) == 1
    assert page.evaluate(
        "document.getElementById('views').scrollWidth <= document.getElementById('views').clientWidth"
    )
    # What has no room there is one touch away.
    assert page.get_by_label("Collection").is_hidden()
    page.get_by_role("button", name="Site menu").click()
    assert serious(page) == []
    page.get_by_label("Collection").select_option("castings")
    page.wait_for_url("**/?view=find&collection=castings")
    shape = stored(service)[0]
    page.goto(f"{visit.here}/shapes/{shape['id']}/view")
    page.wait_for_selector("#cards canvas[data-drawn]")
    assert box_of(page.locator("header"))["height"] <= 60
    assert serious(page) == []
    # The page asks for nothing of a collection that is gone.
    page.goto("about:blank")
    service.client.delete("/collections/castings")


@pytest.mark.parametrize("view", ["find", "browse"])
def test_the_first_load_is_less_than_300_kilobytes(visit: Visit, view: str) -> None:
    session = visit.page.context.new_cdp_session(visit.page)
    session.send("Network.enable")
    loaded: list[int] = []
    session.on("Network.loadingFinished", lambda event: loaded.append(event["encodedDataLength"]))
    visit.open(view)
    visit.page.wait_for_load_state("networkidle")
    print(f"{len(loaded)} answers, {sum(loaded)} bytes")
    assert len(loaded) > 10
    assert sum(loaded) < 300_000
