"""Several shapes at once in Browse: tag, move, delete and restore, export as a table and as files."""

import csv
import io
import zipfile
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.service.support import Running, relate, working_in
from tests.soak.browser.support import NAMES, PHONE, Visit, made, serious, stored

FISH = ("fish-0.ply", "fish-1.ply", "fish-2.ply")


def select(page: Page, *names: str) -> None:
    for name in names:
        page.get_by_role("checkbox", name=f"Select {name}").check()
    expect(page.locator("#selection-count")).to_have_text(f"{len(names)} selected")


def press(page: Page, name: str) -> None:
    page.locator("#selection").get_by_role("button", name=name, exact=True).click()


def told(page: Page, text: str) -> None:
    expect(page.locator("#selection-status")).to_have_text(text)


def saved(page: Page, name: str, file: str) -> bytes:
    """The file that a button saves."""
    with page.expect_download() as download:
        press(page, name)
    assert download.value.suggested_filename == file
    return Path(download.value.path()).read_bytes()


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_selected_shapes_are_tagged(visit: Visit, service: Running) -> None:
    page = visit.open("browse")
    assert page.is_hidden("#selection")
    select(page, *FISH)
    assert serious(page) == []
    page.fill("#selection-tags", "checked, made")
    page.keyboard.press("Enter")
    told(page, "3 shapes tagged.")
    assert {shape["name"]: shape["tags"] for shape in stored(service, tag="checked")} == {
        name: ["fish", "made", "checked"] for name in FISH
    }
    # The cards show it, and the shapes are still selected.
    expect(page.locator("#gallery li").first.locator(".tags a")).to_have_text(["fish", "made", "checked"])
    page.get_by_role("checkbox", name="Select fish-2.ply").uncheck()
    page.fill("#selection-tags", "checked")
    press(page, "Remove")
    told(page, "2 shapes untagged.")
    assert [shape["name"] for shape in stored(service, tag="checked")] == ["fish-2.ply"]
    press(page, "Select none")
    expect(page.locator("#selection")).to_be_hidden()
    service.clear()


def test_similar_shapes_suggest_tags_for_all_that_are_selected(visit: Visit, service: Running) -> None:
    for number in range(4, 8):
        service.store(made("fish", number), f"fish-{number}.ply", tags="fish, swims")
    for shape in stored(service, tag="fish")[:1]:
        service.client.patch(f"/shapes/{shape['id']}", json={"tags": ["fish", "swims"]})
    relate(service)
    page = visit.open("browse")
    select(page, *FISH)
    press(page, "Suggest tags")
    told(page, "3 shapes compared.")
    suggested = page.locator("#selection-suggested li")
    expect(suggested).to_have_text(["Add swims, to fish-1.ply, fish-2.ply"])
    assert serious(page) == []
    press(page, "Add swims")
    told(page, "2 shapes tagged.")
    expect(suggested).to_have_count(0)
    assert {shape["name"] for shape in stored(service, tag="swims")} >= set(FISH)
    # They have it now.
    page.wait_for_load_state("networkidle")
    press(page, "Suggest tags")
    told(page, "3 shapes compared. No tags are suggested.")
    service.clear()


def test_selected_shapes_are_moved_and_what_cannot_be_is_told(visit: Visit, service: Running) -> None:
    with working_in(service, "castings") as other:
        other.store(made("fish", 1), "fish-1.ply")
        visit.expected = ["409"]
        page = visit.open("browse")
        select(page, *FISH)
        page.wait_for_load_state("networkidle")
        page.select_option("#selection-collection", "castings")
        press(page, "Move")
        expect(page.locator("#selection-status")).to_contain_text(
            "2 shapes moved to castings. 1 not: fish-1.ply:"
        )
        expect(page.locator("#selection-count")).to_have_text("1 selected")
        expect(page.locator("#gallery .name")).to_have_text([name for name in NAMES if name not in FISH[::2]])
        assert page.get_by_role("checkbox", name="Select fish-1.ply").is_checked()
        assert sorted(shape["name"] for shape in stored(other)) == list(FISH)
        # The page asks for nothing of a shape that is gone.
        page.goto("about:blank")
        other.clear()
        assert other.client.delete("/collections/castings").status_code == 204


def test_selected_shapes_are_deleted_and_restored_together(visit: Visit, service: Running) -> None:
    before = stored(service)
    page = visit.open("browse")
    # The picture of a shape that is deleted meanwhile is not found.
    page.wait_for_load_state("networkidle")
    select(page, "fish-0.ply", "glasses-2.ply")
    press(page, "Delete")
    told(page, "2 shapes deleted.")
    expect(page.locator("#gallery li")).to_have_count(4)
    expect(page.locator("#undo")).to_contain_text(
        "2 shapes were deleted. You can restore them within 7 days."
    )
    page.get_by_role("button", name="Undo: restore 2 shapes").click()
    expect(page.locator("#undo")).to_have_text("2 shapes were restored.")
    expect(page.locator("#selection")).to_be_hidden()
    told(page, "")
    expect(page.locator("#gallery li")).to_have_count(6)
    assert [shape["id"] for shape in stored(service)] == [shape["id"] for shape in before]


def test_all_that_match_are_exported(visit: Visit, service: Running) -> None:
    # A name that a spreadsheet would take for a formula, and one that two shapes have.
    service.store(made("fish", 4), "=1+1.ply", tags="fish", metadata='{"source": "a, \\"b\\"", "year": 2024}')
    service.store(made("fish", 5), "fish-0.ply", tags="fish")
    page = visit.open("browse", tag="fish")
    page.get_by_role("checkbox", name="Select fish-1.ply").check()
    press(page, "Select all that match")
    shapes = stored(service, tag="fish")
    expect(page.locator("#selection-count")).to_have_text("5 selected")
    rows = list(csv.DictReader(io.StringIO(saved(page, "Export CSV", "shapes.csv").decode())))
    by_id = {row["id"]: row for row in rows}
    assert len(by_id) == len(shapes) == 5
    for shape in shapes:
        row, facts = by_id[shape["id"]], shape["facts"]
        assert row["name"].removeprefix("'") == shape["name"]
        assert not row["name"].startswith("=")
        assert row["tags"] == ", ".join(shape["tags"])
        assert [float(row[side]) for side in ("length", "width", "height")] == facts["bounding_box"]
        assert [float(row[side]) for side in "xyz"] == facts["file_box"]
        assert float(row["volume"]) == facts["volume"]
        assert row["metadata.source"] == shape["metadata"].get("source", "")
        assert row["metadata.year"] == str(shape["metadata"].get("year", ""))
    archive = zipfile.ZipFile(io.BytesIO(saved(page, "Export files", "shapes.zip")))
    assert archive.testzip() is None
    assert sorted(archive.namelist()) == [
        "=1+1.ply",
        "fish-0 (2).ply",
        "fish-0.ply",
        "fish-1.ply",
        "fish-2.ply",
    ]
    assert sorted(map(archive.read, archive.namelist())) == sorted(
        made("fish", pose) for pose in (0, 1, 2, 4, 5)
    )
    page.select_option("#selection-format", "stl")
    archive = zipfile.ZipFile(io.BytesIO(saved(page, "Export files", "shapes.zip")))
    assert archive.testzip() is None
    same = [service.client.get(f"/shapes/{shape['id']}/file?format=stl").content for shape in shapes]
    assert sorted(map(archive.read, archive.namelist())) == sorted(same)
    assert all(name.endswith(".ply.stl") or name.endswith(" (2).stl") for name in archive.namelist())
