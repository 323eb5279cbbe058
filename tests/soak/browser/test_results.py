"""Results: more of them, their table, what differs, the stored query, and how shapes are placed."""

import csv
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from core.io import write_mesh
from tests.service.support import Running, query
from tests.soak.browser.support import Visit, drawn, file_in, made, serious, stored
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part

BRACKET = part("bracket", Drawing(6, 0.1))


def saved(page: Page, folder: Path) -> list[dict[str, str]]:
    """The rows of the table that the page exports."""
    with page.expect_download() as download:
        page.get_by_role("button", name="Export as CSV").click()
    download.value.save_as(folder / download.value.suggested_filename)
    with (folder / download.value.suggested_filename).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_more_results_are_shown_until_there_are_no_more(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    more = page.get_by_role("button", name="More", exact=True)
    more.click()
    drawn(page, 7)
    expect(more).to_be_hidden()
    assert "top_k=7" in page.url
    page.go_back()
    drawn(page, 4)
    expect(more).to_be_visible()


def test_the_results_are_exported_as_a_table(visit: Visit, service: Running, tmp_path: Path) -> None:
    service.store(made("fish", 4), '=1+"a", fish.ply', tags="fish,made")
    page = visit.find(file_in(tmp_path))
    answer = query(service.client, made("fish", 3), "q.ply", rank_by="combined").json()["results"]
    rows = saved(page, tmp_path)
    assert (tmp_path / "similar to fish-3.ply.csv").exists()
    assert len(rows) == len(answer) == 3
    for row, result in zip(rows, answer, strict=True):
        shape = result["shape"]
        name = shape["name"]
        assert row["name"] == (f"'{name}" if name.startswith("=") else name)
        assert (row["id"], row["tags"], row["likeness"]) == (shape["id"], "fish, made", result["likeness"])
        numbers = {key: float(row[key]) for key in ("cc", "ssd", "sim", "combined", "size_ratio")}
        assert numbers == pytest.approx({key: result[key] for key in numbers}, rel=1e-6)
        sides = [float(row[key]) for key in ("length", "width", "height")]
        assert sides == pytest.approx(shape["facts"]["bounding_box"])
        assert row["part_distance"] == row["difference"] == ""


def test_a_variant_says_what_differs_on_its_card_and_in_the_table(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    service.clear()
    data = write_mesh(moved(part("bracket", Drawing(6, 0.1, change="hole")), 1), "stl")
    service.store(data, "hole.stl")
    page = visit.open()
    page.set_input_files("#find-file", file_in(tmp_path, write_mesh(BRACKET, "stl"), "bracket.stl"))
    drawn(page, 2)
    told = query(service.client, write_mesh(BRACKET, "stl"), "q.stl").json()["results"][0]["difference"][
        "text"
    ]
    assert told.startswith("5 through holes instead of 4, at (")
    assert page.locator("#cards .likeness").all_inner_texts() == ["Variant"]
    assert page.locator("#cards .change").all_inner_texts() == [told]
    assert [row["difference"] for row in saved(page, tmp_path)] == [told]


def test_the_query_can_be_stored_and_its_link_then_leads_to_the_results(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    page = visit.find(file_in(tmp_path))
    names = page.locator("#cards h3").all_inner_texts()
    store = page.get_by_role("button", name="Store this query")
    assert serious(page) == []
    store.click()
    expect(page.locator("#find-share")).to_have_text("Stored. The link of this page leads to these results.")
    expect(store).to_be_hidden()
    drawn(page, 4)
    assert page.locator("#cards h3").all_inner_texts() == names
    (shape,) = stored(service, name="fish-3")
    assert service.client.get(f"/shapes/{shape['id']}/file").content == made("fish", 3)
    assert f"shape_id={shape['id']}" in page.url
    page.go_back()
    expect(store).to_be_visible()
    drawn(page, 4)
    store.click()
    expect(page.locator("#find-share")).to_contain_text("It was stored already.")


def test_a_search_for_a_part_says_what_it_is_sorted_by(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    expect(page.locator("#results-summary")).to_contain_text("sorted by combined.")
    page.locator("#find-filters summary").click()
    page.get_by_label("The query is a part of a shape").check()
    expect(page.locator("#results-summary")).to_contain_text("sorted by part distance, the least first.")
    expect(page.locator("#find-rank")).to_be_disabled()
    drawn(page, 4)
    distances = [float(row["part_distance"]) for row in saved(page, tmp_path)]
    assert distances == sorted(distances)
    page.locator("#cards .numbers summary").first.click()
    terms = page.locator("#cards .scores").first.locator("dt").all_inner_texts()
    assert "part distance" in terms
