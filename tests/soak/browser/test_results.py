"""Results: more of them, their table, what differs, the stored query, and how shapes are placed."""

import csv
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.service.support import Running, query
from tests.soak.browser.support import (
    Visit,
    drawn,
    file_in,
    made,
    next_frame,
    paint,
    picture,
    pictures,
    serious,
    stored,
)
from tests.studies.copies import moved
from tests.studies.machine_parts import Change, Drawing, part
from tests.studies.print_plates import plate

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


def test_a_plate_that_has_the_query_is_a_card_after_the_results(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    service.clear()
    for seed in range(3):
        service.store(write_mesh(moved(BRACKET, seed), "stl"), f"{seed}.stl")
    service.store(write_mesh(plate([BRACKET] * 4), "stl"), "plate.stl")
    page = asked(visit, file_in(tmp_path, write_mesh(BRACKET, "stl"), "bracket.stl"), 5)
    assert page.locator("#cards h3").all_inner_texts()[-1] == "4. plate.stl"
    told = ["Same part"] * 3 + ["Contains it 4 times"]
    assert page.locator("#cards .likeness").all_inner_texts() == told
    assert [row["instances"] for row in saved(page, tmp_path)] == ["", "", "", told[-1]]


def plainly(page: Page) -> list[np.ndarray]:
    """The pixels of each shape, in one colour and without points."""
    page.uncheck("#points")
    paint(page, "plain")
    return pictures(page)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """The share of pixels that differ by more than the shades of two tessellations."""
    return float((np.abs(one - other).max(axis=2) > 40).mean())


def asked(visit: Visit, path: Path, count: int = 2) -> Page:
    """Query with a file, and wait for the drawings."""
    page = visit.open()
    page.set_input_files("#find-file", path)
    drawn(page, count)
    return page


@pytest.mark.parametrize("change", [None, "hole"])
def test_copies_and_variants_are_drawn_in_the_frame_of_the_query(
    visit: Visit, service: Running, tmp_path: Path, change: Change | None
) -> None:
    service.clear()
    other = moved(part("bracket", Drawing(6, 0.1, 0.37, change)), 1, scale=25.4)
    service.store(write_mesh(other, "stl"), "other.stl")
    first, second = plainly(asked(visit, file_in(tmp_path, write_mesh(BRACKET, "stl"), "bracket.stl")))
    assert (np.ptp(first, axis=2) > 30).mean() > 0.05
    # A hole is seen or hidden; a part that stands otherwise differs at a tenth of the pixels.
    assert apart(first, second) < 0.02
    own, _ = plainly(asked(visit, file_in(tmp_path, write_mesh(other, "stl"), "other.stl")))
    assert apart(first, own) > 0.05


def test_a_mirror_image_is_drawn_as_the_query_seen_in_a_mirror(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    service.clear()
    service.store(write_mesh(moved(BRACKET, 2, mirrored=True), "stl"), "other.stl")
    page = asked(visit, file_in(tmp_path, write_mesh(BRACKET, "stl"), "bracket.stl"))
    first, second = plainly(page)
    assert page.locator("#cards .likeness").all_inner_texts() == ["Mirror image"]
    image = Mesh(BRACKET.vertices * [-1, 1, 1], BRACKET.faces[:, ::-1])
    own, _ = plainly(asked(visit, file_in(tmp_path, write_mesh(image, "stl"), "image.stl")))
    assert apart(second, own) < 0.01
    assert apart(second, first) > 0.05


def test_the_axis_that_is_chosen_points_up_in_every_drawing(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    service.clear()
    shape = service.store(write_mesh(moved(BRACKET, 3), "off"), "other.off")
    # y is up in OBJ.
    y_up = plainly(asked(visit, file_in(tmp_path, write_mesh(BRACKET, "obj"), "bracket.obj")))
    page = asked(visit, file_in(tmp_path, write_mesh(BRACKET, "off"), "bracket.off"))
    before = plainly(page)
    assert apart(before[0], y_up[0]) > 0.05
    page.select_option("#up", "+Y")
    next_frame(page)
    for one, other in zip(pictures(page), y_up, strict=True):
        assert apart(one, other) < 0.01
    page.select_option("#up", "-Z")
    next_frame(page)
    over = Mesh(BRACKET.vertices * [1, -1, -1], BRACKET.faces)
    upside_down = pictures(page)
    page.select_option("#up", "")
    next_frame(page)
    for one, other in zip(pictures(page), before, strict=True):
        assert apart(one, other) < 0.01
    turned = plainly(asked(visit, file_in(tmp_path, write_mesh(over, "off"), "over.off")))
    for one, other in zip(upside_down, turned, strict=True):
        assert apart(one, other) < 0.01
    # The choice stays, on the page of a shape too.
    page.select_option("#up", "+X")
    page.goto(f"{visit.here}/shapes/{shape['id']}/view")
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(1)
    expect(page.locator("#up")).to_have_value("+X")
    lying = picture(page.locator("#cards canvas"))
    page.select_option("#up", "+Z")
    next_frame(page)
    assert apart(lying, picture(page.locator("#cards canvas"))) > 0.05
    assert serious(page) == []


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
    expect(page.locator("#results-summary")).to_contain_text("sorted by combined: ")
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
