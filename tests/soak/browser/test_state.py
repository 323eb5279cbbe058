"""The state of the page: options that search again, the address, Back, links, and three views."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from core.gallery import make_shape
from core.io import write_mesh
from tests.service.support import Running
from tests.soak.browser.support import PHONE, Visit, box_of, drawn, file_in, made, serious, stored
from tests.studies.copies import moved


def shown_names(page: Page) -> list[str]:
    """The names of the results."""
    return [title.split(". ")[1] for title in page.locator("#cards h3").all_inner_texts()[1:]]


def drop(page: Page, name: str, data: bytes) -> None:
    """Drop a file on the header of the page."""
    transfer = page.evaluate_handle(
        """([name, data]) => {
            const transfer = new DataTransfer();
            transfer.items.add(new File([Uint8Array.from(data)], name));
            return transfer;
        }""",
        [name, list(data)],
    )
    page.dispatch_event("header h1", "dragover", {"dataTransfer": transfer})
    expect(page.locator("html")).to_have_class("over")
    page.dispatch_event("header h1", "drop", {"dataTransfer": transfer})
    expect(page.locator("html")).not_to_have_class("over")


def test_a_change_of_an_option_searches_again_with_the_same_file(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    page.get_by_role("button", name="More", exact=True).click()
    drawn(page, 7)
    assert page.inner_text("#cards h3 >> nth=0") == "fish-3.ply"
    told = "The link of this page keeps the filters, but not the file."
    expect(page.locator("#find-share")).to_have_text(told)
    page.select_option("#find-rank", "sim")
    expect(page.locator("#results-summary")).to_contain_text("sorted by sim")
    drawn(page, 7)
    page.locator("#find-filters summary").click()
    page.fill("#find-tags", "glasses")
    page.keyboard.press("Enter")
    drawn(page, 4)
    assert all(name.startswith("glasses-") for name in shown_names(page))
    expect(page.locator("#find-filter-count")).to_have_text("(1)")
    page.fill("#find-tags", "")
    page.keyboard.press("Enter")
    drawn(page, 7)
    # One entry of the history for each search.
    page.go_back()
    drawn(page, 4)
    assert page.input_value("#find-tags") == "glasses"
    page.reload()
    expect(page.locator("#find-error")).to_contain_text("Choose fish-3.ply again")
    assert page.input_value("#find-count") == "7"


def test_back_and_forward_show_what_was_shown(visit: Visit, tmp_path: Path) -> None:
    page = visit.open()
    page.get_by_role("link", name="Find similar to fish-0.ply").click()
    drawn(page, 4)
    page.get_by_role("link", name="Browse", exact=True).click()
    page.wait_for_selector("#gallery li")
    page.locator("#gallery-filters summary").click()
    page.fill("#gallery-tags", "glasses")
    expect(page.locator("#gallery li")).to_have_count(3)
    page.get_by_role("link", name="Find similar to glasses-1.ply").click()
    expect(page.locator("#find-name")).to_have_text("glasses-1.ply")
    drawn(page, 4)
    page.go_back()
    expect(page.locator("#gallery li")).to_have_count(3)
    assert page.input_value("#gallery-tags") == "glasses"
    assert page.is_hidden("#results")
    page.go_back()
    expect(page.locator("#find-name")).to_have_text("fish-0.ply")
    drawn(page, 4)
    page.go_back()
    page.wait_for_selector("#start-shapes li")
    assert page.is_hidden("#results")
    page.go_forward()
    expect(page.locator("#find-name")).to_have_text("fish-0.ply")
    # The link of a view leads to its last state.
    page.set_input_files("#find-file", file_in(tmp_path))
    expect(page.locator("#find-name")).to_have_text("fish-3.ply")
    drawn(page, 4)
    page.get_by_role("link", name="Browse", exact=True).click()
    page.get_by_role("link", name="Find", exact=True).click()
    expect(page.locator("#find-name")).to_have_text("fish-3.ply")
    drawn(page, 4)
    page.get_by_role("button", name="Clear").click()
    page.wait_for_selector("#start-shapes li")
    assert page.is_hidden("#results")


def test_a_link_leads_to_the_same_results(visit: Visit, service: Running) -> None:
    page = visit.open(top_k="6")
    page.locator("#find-filters summary").click()
    page.fill("#find-tags", "fish")
    page.get_by_role("link", name="Find similar to fish-0.ply").click()
    drawn(page, 3)
    expect(page.locator("#find-share")).to_have_text("The link of this page leads to these results.")
    names = shown_names(page)
    assert sorted(names) == ["fish-1.ply", "fish-2.ply"]
    assert f"shape_id={stored(service, name='fish-0')[0]['id']}" in page.url
    other = page.context.new_page()
    other.goto(page.url)
    drawn(other, 3)
    assert shown_names(other) == names
    assert other.input_value("#find-count") == "6"
    assert other.input_value("#find-tags") == "fish"
    other.goto(f"{visit.here}/?view=browse&tag=glasses")
    expect(other.locator("#gallery li")).to_have_count(3)


def test_a_filter_of_the_address_without_a_field_filters_until_it_is_removed(
    visit: Visit, service: Running
) -> None:
    page = visit.open("browse", name="fish-1")
    shown = page.locator("#gallery .name")
    expect(shown).to_have_text(["fish-1.ply"])
    expect(page.locator("#facet-groups li").first).to_contain_text("1")
    assert serious(page) == []
    page.fill("#gallery-words", "glasses")
    expect(page.locator("#gallery-status")).to_have_text("No stored shape matches.")
    assert "name=fish-1" in page.url
    page.fill("#gallery-words", "fish")
    expect(shown).to_have_text(["fish-1.ply"])
    page.get_by_role("button", name="Remove the filter Name: fish-1").click()
    expect(shown).to_have_text(["fish-0.ply", "fish-1.ply", "fish-2.ply"])
    expect(page.locator("#gallery-words")).to_be_focused()
    assert page.url.endswith("/?view=browse&q=fish")
    fish = stored(service, tag="fish")
    page = visit.open("browse", sha256=fish[2]["sha256"])
    expect(shown).to_have_text(["fish-2.ply"])
    page = visit.open("map", name="fish", file_format="ply")
    expect(page.locator("#map a")).to_have_count(3)
    page.get_by_role("button", name="Remove the filter Name: fish").click()
    expect(page.locator("#map a")).to_have_count(6)
    assert page.url.endswith("/?view=map&file_format=ply")
    page.goto(f"{visit.here}/?shape_id={fish[0]['id']}&name=fish&exclude={fish[1]['id']}&exclude=")
    drawn(page, 2)
    assert shown_names(page) == ["fish-2.ply"]
    page.get_by_role("button", name=f"Remove the filter Without: {fish[1]['id']}").click()
    drawn(page, 3)
    assert sorted(shown_names(page)) == ["fish-1.ply", "fish-2.ply"]


def test_a_filter_of_the_address_limits_what_is_merged(visit: Visit, service: Running) -> None:
    service.store(write_mesh(moved(make_shape("fish", 0), 1), "ply"), "copy.ply")
    page = visit.page
    page.goto(f"{visit.here}/?view=duplicates&name=glasses&metadata=source%3Dscan&metadata=year%3D2024")
    expect(page.locator("#duplicates-status")).to_have_text("No duplicates among 0 shapes.")
    merge = page.get_by_role("button", name="Merge groups of the same part")
    merge.click()
    expect(page.locator("#duplicates-decided")).to_have_text("No undecided group has the same part only.")
    assert serious(page) == []
    for text in ("Metadata: year=2024", "Name: glasses", "Metadata: source=scan"):
        page.get_by_role("button", name=f"Remove the filter {text}").click()
    expect(page.locator("#duplicates > li")).to_have_count(1)
    merge.click()
    expect(page.locator("#merge-text")).to_contain_text("1 undecided group of the same part: ")


def test_a_link_to_a_deleted_shape_says_so(visit: Visit) -> None:
    visit.expected = ["404"]
    page = visit.page
    page.goto(f"{visit.here}/?shape_id=00000000-0000-4000-8000-000000000000")
    expect(page.locator("#find-error")).to_contain_text("shape")
    page.wait_for_selector("#start-shapes li")


@pytest.mark.parametrize("visit", [{}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_each_view_has_one_form_and_shows_shapes_at_once(visit: Visit) -> None:
    page = visit.open()
    height = page.evaluate("innerHeight")
    for view, shapes in (("find", "#start-shapes li"), ("browse", "#gallery li")):
        page.goto(f"{visit.here}/?view={view}")
        page.wait_for_selector(shapes)
        assert page.locator("main form:visible").count() == 1
        # The picture of the first shape is on the first screen.
        assert box_of(page.locator(shapes).first)["y"] + 150 < height, view
    page.get_by_role("link", name="Upload", exact=True).click()
    assert page.locator("main form:visible").count() == 1
    assert page.locator("#views a[aria-current]").all_inner_texts() == ["Upload"]


def test_a_file_may_be_dropped_anywhere(visit: Visit, service: Running) -> None:
    page = visit.open("browse")
    drop(page, "dropped.ply", made("fish", 3))
    expect(page.locator("#find-name")).to_have_text("dropped.ply")
    drawn(page, 4)
    assert len(stored(service)) == 6
    page.get_by_role("link", name="Upload", exact=True).click()
    drop(page, "dropped.ply", made("fish", 3))
    expect(page.locator("#upload-status")).to_contain_text("1 stored")
    assert len(stored(service, name="dropped")) == 1
