"""The choice of a collection, where there are several."""

from collections.abc import Iterator

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from tests.service.collections.support import working_in
from tests.service.support import Running
from tests.soak.browser.support import Visit, drawn, made, stocked_names


@pytest.fixture
def other(service: Running) -> Iterator[Running]:
    """A collection beside the default one, with two shapes."""
    with working_in(service, "castings") as other:
        for pose in (4, 5):
            other.store(made("fish", pose), f"cast-{pose}.ply", tags="cast")
        yield other
        shapes = other.client.get("/shapes").json()["shapes"]
        for shape in shapes:
            assert other.client.delete(f"/shapes/{shape['id']}").status_code == 204
        for shape in other.client.get("/deleted").json()["shapes"]:
            assert other.client.delete(f"/deleted/{shape['id']}").status_code == 204
        assert other.client.delete("/collections/castings").status_code == 204


def test_one_collection_is_no_choice(visit: Visit) -> None:
    page = visit.open("browse")
    expect(page.locator("#gallery li")).to_have_count(len(stocked_names()))
    expect(page.locator("#collections")).to_be_hidden()


def test_the_page_works_in_the_collection_that_is_chosen(visit: Visit, other: Running) -> None:
    page = visit.open("browse")
    choice = page.get_by_label("Collection")
    assert choice.locator("option").all_text_contents() == ["castings (2)", "default (6)"]
    expect(choice).to_have_value("default")
    choice.select_option("castings")
    page.wait_for_url("**/?view=browse&collection=castings")
    names = page.locator("#gallery .name")
    expect(names).to_have_text(["cast-4.ply", "cast-5.ply"])
    expect(page.locator("#gallery li img").last).to_have_js_property("naturalWidth", 256)
    # A query finds the one other shape of the collection, and what it shows is loaded from there.
    page.get_by_role("link", name="Find similar to cast-4.ply").click()
    drawn(page, 2)
    page.reload()
    expect(page.get_by_label("Collection")).to_have_value("castings")
    serious = [
        fault
        for fault in Axe().run(page).response["violations"]
        if fault["impact"] in {"serious", "critical"}
    ]
    assert serious == []
    page.get_by_role("link", name="Browse", exact=True).click()
    expect(names).to_have_count(2)
    names.first.click()
    page.wait_for_url("**/view?collection=castings")
    expect(page.locator("#title")).to_have_text("cast-4.ply")
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(1)
    page.get_by_role("link", name="All shapes").click()
    page.wait_for_url("**/?collection=castings")
    expect(page.locator("#start-shapes li")).to_have_count(2)
