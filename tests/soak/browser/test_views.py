"""The other views: upload, map, duplicates, collections, a comparison, the documentation; and signing in."""

import csv
from collections.abc import Iterator
from itertools import combinations, pairwise
from math import hypot
from pathlib import Path
from statistics import mean

import pytest
from playwright.sync_api import Browser, expect

from core.gallery import make_shape
from core.io import write_mesh
from service.auth.keys import digest_of
from tests.service.jobs.support import pack
from tests.service.support import Running, serving, settings_in, small_file, working_in
from tests.soak.browser.support import (
    PHONE,
    Visit,
    box_of,
    choose,
    drawn,
    file_in,
    held_back,
    made,
    next_frame,
    serious,
    stock,
    stored,
    visiting,
)
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part

KEY, READ_KEY = "isoshape_full-key", "isoshape_read-key"
desktop_and_phone = pytest.mark.parametrize(
    "visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"]
)


def test_many_files_are_stored_and_a_bad_one_is_told_of(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    files = [file_in(tmp_path, small_file(number), f"new-{number}.off") for number in range(4)]
    bad = file_in(tmp_path, b"not a mesh", "bad.off")
    visit.expected = ["422"]
    page = visit.open("upload")
    page.fill("#upload-tags", "new, bulk")
    page.set_input_files("#upload-files", [files[0], bad, *files[1:]])
    status = page.locator("#upload-status")
    expect(status).to_have_text("4 stored, 0 already stored, 1 not stored, 0 waiting")
    rows = page.locator("#uploads li")
    assert rows.count() == 5
    assert rows.nth(0).locator("progress").get_attribute("value") == "1"
    detail = service.client.post("/shapes", files={"file": ("bad.off", b"not a mesh")}).json()["detail"]
    assert detail in rows.nth(1).inner_text()
    shapes = stored(service, tag="bulk")
    assert sorted(shape["name"] for shape in shapes) == [file.name for file in files]
    assert all(shape["tags"] == ["new", "bulk"] for shape in shapes)
    expect(page.locator("#gallery li")).to_have_count(10)
    visit.open("upload").set_input_files("#upload-files", files[:1])
    expect(status).to_have_text("0 stored, 1 already stored, 0 not stored, 0 waiting")


def test_an_archive_is_stored_with_progress_and_its_bad_file_told_of(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    members = {f"new/{number}.off": small_file(number) for number in range(3)}
    archive = file_in(
        tmp_path, pack({**members, "new/bad.off": b"not a mesh", "README.txt": b"Print it."}), "parts.zip"
    )
    page = visit.open("upload")
    page.fill("#upload-tags", "packed")
    page.set_input_files("#upload-files", archive)
    row = page.locator("#jobs > li")
    expect(row).to_have_count(1)
    expect(row.locator("span").nth(1)).to_have_text("3 of 4 stored, 0 already stored, 1 not stored")
    expect(row.locator("progress")).to_have_js_property("value", 1)
    job = service.client.get("/jobs").json()["jobs"][0]
    refused = service.client.get(f"/jobs/{job['id']}/files", params={"outcome": "refused"}).json()["files"]
    (bad,) = (file for file in refused if file["path"] == "new/bad.off")
    expect(row.locator("li")).to_have_text(f"new/bad.off: {bad['problem']['detail']}")
    expect(row.get_by_role("button")).to_have_count(0)
    expect(page.locator("#gallery li")).to_have_count(9)
    assert len(stored(service, tag="packed")) == 3
    page.set_input_files("#upload-files", archive)
    expect(row.nth(1).locator("span").nth(1)).to_have_text("0 of 4 stored, 3 already stored, 1 not stored")
    visit.expected = ["4"]
    page.set_input_files("#upload-files", file_in(tmp_path, b"PK no archive", "broken.zip"))
    expect(page.locator("#jobs .bad").last).to_contain_text("archive")


def test_a_comparison_as_a_page(visit: Visit, service: Running) -> None:
    shapes = stored(service, tag="fish")
    page = visit.open("browse")
    # A form of another kind cannot send JSON, so the page is put in place of this one.
    page.route(
        "**/compare?format=html",
        lambda route: route.continue_(
            method="POST",
            post_data={"first": shapes[0]["id"], "second": shapes[1]["id"]},
            headers={"content-type": "application/json"},
        ),
    )
    page.goto(f"{visit.here}/compare?format=html")
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(2)
    assert page.inner_text("#title") == f"{shapes[0]['name']} and {shapes[1]['name']}"
    page.locator("#cards summary").click()
    assert "CC" in page.inner_text("#cards")
    page.get_by_role("link", name="Map", exact=True).click()
    page.wait_for_selector("#map li")


def test_the_documentation_is_drawn(visit: Visit) -> None:
    visit.page.goto(f"{visit.here}/docs")
    visit.page.wait_for_selector(".opblock")
    assert visit.page.locator(".opblock").count() > 10
    visit.page.get_by_role("link", name="Browse", exact=True).click()
    visit.page.wait_for_selector("#gallery li")


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with keys, holding shapes."""
    keys = {"api_keys": (digest_of(KEY),), "read_keys": (digest_of(READ_KEY),)}
    with serving(settings_in(tmp_path_factory.mktemp("locked"), workers=1, **keys), key=KEY) as running:
        stock(running)
        yield running


@pytest.mark.parametrize(("key", "may_store"), [(KEY, True), (READ_KEY, False)])
def test_signing_in_with_a_key(
    browser: Browser, locked: Running, tmp_path: Path, key: str, may_store: bool
) -> None:
    with visiting(browser, locked) as visit:
        # The wrong key is the only thing that goes wrong.
        visit.expected = ["401"]
        page = visit.open("browse")
        held = held_back(page, "**/jobs*")
        assert page.locator("#gallery li").count() == 0
        assert page.is_hidden("#signed-in")
        page.fill("#key", "isoshape_wrong")
        page.keyboard.press("Enter")
        expect(page.locator("#sign-in-error")).to_contain_text("does not know this key")
        page.fill("#key", key)
        page.keyboard.press("Enter")
        page.wait_for_selector("#gallery li")
        assert page.get_by_role("link", name="Upload", exact=True).is_visible() == may_store
        page.get_by_role("button", name="Menu of fish-0.ply").click()
        delete = page.locator("#card-menu").get_by_role("button", name="Delete")
        expect(delete).to_have_count(int(may_store))
        # An answer that comes late closes no menu.
        assert len(held) == may_store
        for route in held:
            with page.expect_response("**/jobs*"):
                route.continue_()
        next_frame(page)
        expect(page.locator("#card-menu")).to_be_visible()
        expect(delete).to_have_count(int(may_store))
        # This service keeps no deleted shapes, so it asks.
        assert page.is_hidden("#deleted")
        if may_store:
            delete.click()
            assert "You cannot restore it." in page.inner_text("#deletion-text")
            page.locator("#deletion").get_by_role("button", name="Cancel").click()
            choose(page, "fish-0.ply", "Delete")
            page.keyboard.press("Escape")
            assert len(stored(locked)) == 6
        page.keyboard.press("Escape")
        page.set_input_files("#find-file", file_in(tmp_path))
        expect(page.locator("#cards canvas[data-drawn]")).to_have_count(4)
        page.goto(f"{visit.here}/shapes/{stored(locked)[0]['id']}/view")
        expect(page.locator("#facts")).to_contain_text("faces")
        assert page.locator("#edit-open").is_visible() == may_store
        visit.open()
        page.click("#sign-out")
        page.wait_for_selector("#sign-in:not([hidden])")
        assert page.locator("#gallery li").count() == 0


def test_no_card_is_drawn_before_the_page_knows_what_its_key_allows(
    browser: Browser, locked: Running
) -> None:
    starts = iter([{"status": 503, "json": {"detail": "it reads"}}])
    with visiting(browser, locked) as visit:
        visit.expected = ["503"]
        page = visit.page
        page.route("**/readyz", lambda route: route.fulfill(**next(starts, {"json": {"detail": None}})))
        held = held_back(page, "**/collections*")
        page.goto(f"{visit.here}/?view=browse")
        page.fill("#key", KEY)
        with page.expect_request("**/collections*"):
            page.keyboard.press("Enter")
        expect(page.locator("#starting")).to_be_hidden()
        next_frame(page)
        assert page.locator("#gallery li").count() == 0
        held[0].continue_()
        page.get_by_role("button", name="Menu of fish-0.ply").click()
        expect(page.locator("#card-menu").get_by_role("button", name="Delete")).to_be_visible()


@desktop_and_phone
def test_the_map_shows_similar_shapes_near_each_other(visit: Visit) -> None:
    page = visit.open("map")
    links = page.locator("#map a")
    expect(links).to_have_count(6)
    expect(page.locator("#map-status")).to_contain_text("6 shapes")
    boxes = {}
    for link in links.all():
        boxes[link.get_attribute("title")] = box_of(link)
    # Pictures do not overlap.
    places = {name: (box["x"], box["y"]) for name, box in boxes.items()}
    width = boxes["fish-0.ply"]["width"]
    assert all(
        b[0] - a[0] > width - 1 or abs(b[1] - a[1]) > width - 1 for a, b in pairwise(sorted(places.values()))
    )
    apart: dict[bool, list[float]] = {True: [], False: []}
    for (one, a), (other, b) in combinations(places.items(), 2):
        apart[one[:4] == other[:4]].append(hypot(a[0] - b[0], a[1] - b[1]))
    assert mean(apart[True]) < 0.8 * mean(apart[False]), boxes
    assert serious(page) == []
    page.get_by_role("button", name="Zoom out").click()
    assert box_of(links.first)["width"] < width
    page.get_by_role("button", name="Reset view").click()
    assert box_of(links.first)["width"] == pytest.approx(width, abs=1)
    page.fill("#map-tags", "fish")
    page.keyboard.press("Enter")
    expect(links).to_have_count(3)
    assert "view=map&tag=fish" in page.url


def test_the_map_by_keyboard(visit: Visit) -> None:
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


@desktop_and_phone
def test_a_group_of_duplicates_is_shown_and_a_copy_deleted_and_restored(
    visit: Visit, service: Running
) -> None:
    service.store(write_mesh(moved(make_shape("fish", 0), 1, scale=2.0), "ply"), "twice.ply", tags="copy")
    page = visit.open("duplicates", scaled="true")
    groups, status = page.locator("#duplicates > li"), page.locator("#duplicates-status")
    expect(status).to_have_text("1 group of duplicates among 7 shapes.")
    expect(groups).to_have_count(1)
    expect(groups.locator(".name")).to_have_text(["fish-0.ply", "twice.ply"])
    expect(groups.locator(".likeness")).to_have_text(["Stored first", "Same part, 2 times as large"])
    expect(groups.locator("img").last).to_have_js_property("naturalWidth", 256)
    assert serious(page) == []
    choose(page, "twice.ply", "Delete")
    expect(page.locator("#undo")).to_contain_text("twice.ply was deleted.")
    expect(status).to_have_text("No duplicates among 6 shapes.")
    page.get_by_role("button", name="Undo: restore twice.ply").click()
    expect(groups).to_have_count(1)
    page.fill("#duplicates-tags", "glasses")
    page.keyboard.press("Enter")
    expect(status).to_have_text("No duplicates among 3 shapes.")
    assert "view=duplicates&tag=glasses" in page.url


def test_switches_say_which_copies_count_and_the_groups_are_exported(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    bracket = part("bracket", Drawing(6, 0.1))
    meshes = {
        "first": bracket,
        "right": moved(bracket, 1, mirrored=True),
        "twice": moved(bracket, 2, scale=2.0),
        "hole": part("bracket", Drawing(6, 0.1, change="hole")),
    }
    for name, mesh in meshes.items():
        service.store(write_mesh(mesh, "stl"), f"{name}.stl")
    visit.page.goto(f"{visit.here}/?view=duplicates")
    page, names = visit.page, visit.page.locator("#duplicates .name")
    expect(names).to_have_text(["first.stl", "right.stl"])
    page.get_by_label("No mirror images").check()
    expect(page.locator("#duplicates-status")).to_have_text("No duplicates among 10 shapes.")
    expect(page.get_by_role("link", name="Export as CSV")).to_be_hidden()
    page.get_by_label("Other sizes too").check()
    expect(names).to_have_text(["first.stl", "twice.stl"])
    page.get_by_label("Variants too").check()
    expect(names).to_have_text(["first.stl", "twice.stl", "hole.stl"])
    told = service.client.get(
        "/duplicates", params={"scaled": True, "mirrored": False, "variants": True}
    ).json()
    texts = [one["difference"]["text"] if one["difference"] else "" for one in told["groups"][0]]
    assert texts[2].startswith("5 through holes instead of 4, at (")
    expect(page.locator("#duplicates .change")).to_have_text(texts)
    expect(page.locator("#duplicates .likeness")).to_have_text(
        ["Stored first", "Same part, 2 times as large", "Variant"]
    )
    assert serious(page) == []
    with page.expect_download() as download:
        page.get_by_role("link", name="Export as CSV").click()
    assert download.value.suggested_filename == "duplicates.csv"
    download.value.save_as(tmp_path / "duplicates.csv")
    with (tmp_path / "duplicates.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["difference"]) for row in rows] == list(
        zip(["first.stl", "twice.stl", "hole.stl"], texts, strict=True)
    )
    page.reload()
    expect(names).to_have_count(3)


def test_groups_are_decided_one_after_another_by_keys(visit: Visit, service: Running) -> None:
    meshes = {
        "bracket": part("bracket", Drawing(6, 0.1)),
        **{name: make_shape(name, 0) for name in ("cup", "plane")},
    }
    for name, mesh in meshes.items():
        for copy in range(2):
            service.store(write_mesh(moved(mesh, copy), "stl"), f"{name}-{copy}.stl")
    page = visit.open("duplicates")
    groups = page.locator("#duplicates > li")
    expect(groups).to_have_count(3)
    assert serious(page) == []
    page.keyboard.press("1")
    expect(groups).to_have_count(2)
    expect(page.locator("#duplicates-decided")).to_contain_text("Same: bracket-0.stl.")
    groups.nth(1).get_by_role("button", name="Different").click()
    expect(groups).to_have_count(1)
    page.keyboard.press("2")
    expect(groups).to_have_count(0)
    expect(page.locator("#duplicates-status")).to_have_text("No duplicates among 12 shapes.")

    def decided() -> list[str]:
        pairs = service.client.get("/duplicates/decisions").json()["decisions"]
        return [pair["decision"] for pair in pairs]

    assert decided() == ["same", "different", "variant"]
    page.keyboard.press("u")
    expect(groups).to_have_count(1)
    expect(page.locator("#duplicates-decided")).to_have_text("The decision was undone.")
    page.locator("#duplicates-words").press_sequentially("1u")
    assert decided() == ["same", "different"]
    page.locator("#duplicates-words").fill("")
    page.get_by_label("Decided ones too").check()
    expect(groups).to_have_count(3)
    page.keyboard.press("Tab")
    page.keyboard.press("5")
    expect(groups).to_have_count(2)
    expect(page.locator("#duplicates-decided")).to_contain_text("Merged into bracket-0.stl.")

    def brackets() -> list[str]:
        shapes = service.client.get("/shapes", params={"name": "bracket"}).json()["shapes"]
        return [shape["name"] for shape in shapes]

    assert brackets() == ["bracket-0.stl"]
    page.get_by_role("button", name="Undo", exact=True).click()
    expect(groups).to_have_count(3)
    assert brackets() == ["bracket-0.stl", "bracket-1.stl"]

    # Another shape is kept, and what was done before the page was loaded is undone.
    page.keyboard.press("k")
    expect(page.get_by_role("radio", name="Keep bracket-1.stl")).to_be_checked()
    page.keyboard.press("5")
    expect(page.locator("#duplicates-decided")).to_contain_text("Merged into bracket-1.stl.")
    assert brackets() == ["bracket-1.stl"]
    page.reload()
    expect(page.locator("#duplicates .likeness").last).to_have_text("Same part, decided: different")
    page.keyboard.press("u")
    acts = page.locator("#acts-list li .name")
    expect(acts).to_have_text(
        ["Merge: bracket-1.stl, bracket-0.stl", "Different: plane-0.stl, plane-1.stl", "Same: bracket-1.stl"]
    )
    assert serious(page) == []
    expect(page.get_by_role("button", name="Undo Merge: bracket-1.stl, bracket-0.stl")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#duplicates-decided")).to_have_text("The merge was undone.")
    expect(acts).to_have_count(2)
    assert brackets() == ["bracket-0.stl", "bracket-1.stl"]
    # All groups at once that are undecided and have the words.
    page.fill("#duplicates-words", "bracket")
    page.keyboard.press("Enter")
    expect(groups).to_have_count(1)
    merge = page.get_by_role("button", name="Merge groups of the same part")
    merge.click()
    expect(page.locator("#duplicates-decided")).to_have_text("No undecided group has the same part only.")
    page.fill("#duplicates-words", "")
    page.keyboard.press("Enter")
    expect(groups).to_have_count(3)
    merge.click()
    expect(page.locator("#merge-text")).to_contain_text("1 undecided group of the same part: ")
    assert serious(page) == []
    page.select_option("#merge-keep", "newest")
    page.get_by_role("button", name="Merge them").click()
    expect(page.locator("#duplicates-decided")).to_contain_text("Merged 1 group.")
    cups = service.client.get("/shapes", params={"name": "cup"}).json()["shapes"]
    assert [shape["name"] for shape in cups] == ["cup-1.stl"]
    page.keyboard.press("u")
    expect(page.locator("#duplicates-decided")).to_have_text("The merge was undone.")
    expect(groups).to_have_count(3)
    page.get_by_role("button", name="Undo Different: plane-0.stl, plane-1.stl").click()
    expect(acts).to_have_text(["Same: bracket-0.stl, bracket-1.stl"])
    assert decided() == ["same"]


def test_the_page_works_in_the_collection_that_is_chosen(visit: Visit, service: Running) -> None:
    page = visit.open("browse")
    expect(page.locator("#gallery li")).to_have_count(6)
    # One collection is no choice.
    expect(page.locator("#collections")).to_be_hidden()
    with working_in(service, "castings") as other:
        for pose in (4, 5):
            other.store(made("fish", pose), f"cast-{pose}.ply", tags="cast")
        visit.open("browse")
        choice = page.get_by_role("combobox", name="Collection")
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
        expect(choice).to_have_value("castings")
        assert serious(page) == []
        page.get_by_role("link", name="Browse", exact=True).click()
        expect(names).to_have_count(2)
        names.first.click()
        page.wait_for_url("**/view?collection=castings")
        expect(page.locator("#title")).to_have_text("cast-4.ply")
        expect(page.locator("#cards canvas[data-drawn]")).to_have_count(1)
        page.get_by_role("link", name="Find", exact=True).click()
        page.wait_for_url("**/?collection=castings")
        expect(page.locator("#start-shapes li")).to_have_count(2)
        # The page asks for nothing of a shape that is gone.
        page.goto("about:blank")
        other.clear()
        assert other.client.delete("/collections/castings").status_code == 204
