"""Stored shapes: browsing, search, bulk upload, deletion; and signing in."""

from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import pytest
from playwright.sync_api import Browser, expect

from service.auth.keys import digest_of
from tests.service.support import Running, serving, settings_in, small_file
from tests.soak.browser.conftest import watch
from tests.soak.browser.support import PATIENCE, Visit, choose, file_in, made, stock

MANY = 500
KEY, READ_KEY = "isoshape_full-key", "isoshape_read-key"


def test_the_gallery_goes_on_as_one_scrolls(visit: Visit, service: Running) -> None:
    for number in range(MANY):
        service.store(small_file(1), f"ball-{number:03d}.off", tags="ball")
    page = visit.open("browse")
    seen = set()
    for _ in range(400):
        seen |= set(page.locator("#gallery .name").all_text_contents())
        if len(seen) == MANY + 6:
            break
        # Shapes far from the window are not kept in the document.
        assert page.locator("#gallery li").count() < 300
        page.mouse.wheel(0, 1000)
        page.wait_for_timeout(50)
    assert len(seen) == MANY + 6
    expect(page.locator("#gallery-status")).to_have_text(f"{MANY + 6} of {MANY + 6} shown")
    page.evaluate("scrollTo(0, 0)")
    expect(page.locator("#gallery li").first).to_contain_text("fish-0.ply")
    page.keyboard.press("End")
    expect(page.locator("#gallery li").last).to_contain_text(f"ball-{MANY - 1:03d}.off")
    # The last one's picture is there.
    page.locator("#gallery li").last.scroll_into_view_if_needed()
    expect(page.locator("#gallery li").last.locator("img")).to_have_js_property("naturalWidth", 256)
    page.fill("#gallery-name", "BALL-49")
    expect(page.locator("#gallery li")).to_have_count(10)
    page.fill("#gallery-name", "")
    page.locator("#gallery-filters summary").click()
    page.fill("#gallery-tags", "glasses")
    expect(page.locator("#gallery li")).to_have_count(3)
    page.fill("#gallery-tags", "no such tag")
    expect(page.locator("#gallery li")).to_have_count(0)
    expect(page.locator("#gallery-status")).to_have_text("No stored shape matches.")


def test_many_files_are_stored_and_a_bad_one_is_told_of(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    files = []
    for number in range(4):
        files.append(tmp_path / f"new-{number}.off")
        files[-1].write_bytes(small_file(number))
    bad = tmp_path / "bad.off"
    bad.write_text("not a mesh")
    visit.expected = ["422"]
    page = visit.open("upload")
    page.fill("#upload-tags", "new, bulk")
    page.set_input_files("#upload-files", [files[0], bad, *files[1:]])
    outcome = "4 stored, 0 already stored, 1 not stored, 0 waiting"
    expect(page.locator("#upload-status")).to_have_text(outcome)
    rows = page.locator("#uploads li")
    assert rows.count() == 5
    assert rows.nth(0).locator("progress").get_attribute("value") == "1"
    detail = service.client.post("/shapes", files={"file": ("bad.off", b"not a mesh")}).json()["detail"]
    assert detail in rows.nth(1).inner_text()
    stored = service.client.get("/shapes", params={"tag": "bulk"}).json()["shapes"]
    assert sorted(shape["name"] for shape in stored) == [file.name for file in files]
    assert all(shape["tags"] == ["new", "bulk"] for shape in stored)
    expect(page.locator("#gallery li")).to_have_count(10)


def test_an_archive_is_stored_with_progress_and_its_bad_file_told_of(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    archive = tmp_path / "parts.zip"
    with ZipFile(archive, "w") as packed:
        for number in range(3):
            packed.writestr(f"new/{number}.off", small_file(number))
        packed.writestr("new/bad.off", "not a mesh")
    page = visit.open("upload")
    page.fill("#upload-tags", "packed")
    page.set_input_files("#upload-files", archive)
    row = page.locator("#jobs > li")
    expect(row).to_have_count(1)
    expect(row.locator("span").nth(1)).to_have_text("3 of 4 stored, 0 already stored, 1 not stored")
    expect(row.locator("progress")).to_have_js_property("value", 1)
    (job,) = service.client.get("/jobs").json()["jobs"]
    (bad,) = service.client.get(f"/jobs/{job['id']}/files", params={"outcome": "refused"}).json()["files"]
    expect(row.locator("li")).to_have_text(f"new/bad.off: {bad['problem']['detail']}")
    expect(row.get_by_role("button")).to_have_count(0)
    expect(page.locator("#gallery li")).to_have_count(9)
    assert service.client.get("/shapes", params={"tag": "packed"}).json()["total"] == 3
    page.set_input_files("#upload-files", archive)
    expect(row.nth(1).locator("span").nth(1)).to_have_text("0 of 4 stored, 3 already stored, 1 not stored")


def test_a_file_that_is_no_archive_is_told_of(visit: Visit, tmp_path: Path) -> None:
    broken = tmp_path / "broken.zip"
    broken.write_bytes(b"PK no archive")
    visit.expected = ["4"]
    page = visit.open("upload")
    page.set_input_files("#upload-files", broken)
    expect(page.locator("#jobs .bad")).to_contain_text("archive")


def test_a_deleted_shape_is_restored(visit: Visit, service: Running) -> None:
    before = {shape["name"]: shape for shape in service.client.get("/shapes").json()["shapes"]}
    page = visit.open("browse")
    for name in ("fish-1.ply", "glasses-2.ply", "fish-2.ply"):
        choose(page, name, "Delete")
        expect(page.locator("#undo")).to_contain_text(
            f"{name} was deleted. You can restore it within 7 days."
        )
    page.get_by_role("button", name="Undo: restore fish-2.ply").click()
    expect(page.locator("#undo")).to_have_text("fish-2.ply was restored.")
    expect(page.locator("#gallery li")).to_have_count(4)
    # A restored shape is listed where it was.
    expect(page.locator("#gallery .name")).to_have_text(
        [name for name in before if name not in {"fish-1.ply", "glasses-2.ply"}]
    )
    # Others may have been deleted before; the latest comes first.
    page.locator("#deleted summary").click()
    rows = page.locator("#deleted-list li")
    expect(rows.nth(0)).to_contain_text("glasses-2.ply")
    expect(rows.nth(1)).to_contain_text("fish-1.ply")
    total = service.client.get("/deleted").json()["total"]
    expect(page.locator("#deleted-count")).to_have_text(str(total))
    page.get_by_role("button", name="Restore glasses-2.ply").first.click()
    expect(page.locator("#gallery li")).to_have_count(5)
    expect(rows.nth(0)).to_contain_text("fish-1.ply")
    expect(page.locator("#deleted-count")).to_have_text(str(total - 1))
    # For good, if that is confirmed.
    erase = page.get_by_role("button", name="Delete fish-1.ply for good").first
    erase.click()
    page.keyboard.press("Escape")
    expect(page.locator("#deleted-count")).to_have_text(str(total - 1))
    erase.click()
    page.locator("#deletion").get_by_role("button", name="Delete").click()
    expect(page.locator("#deleted-count")).to_have_text(str(total - 2))
    expect(page.locator("#undo")).to_have_text("fish-1.ply was deleted for good.")
    assert service.client.get("/deleted").json()["total"] == total - 2
    after = service.client.get("/shapes").json()["shapes"]
    for shape in after:
        assert [shape[key] for key in ("id", "tags", "sha256")] == [
            before[shape["name"]][key] for key in ("id", "tags", "sha256")
        ]
    assert len(after) == 5


def test_the_page_names_shapes_that_cannot_be_restored(visit: Visit, service: Running) -> None:
    visit.expected = ["409"]
    page = visit.open("browse")
    choose(page, "fish-1.ply", "Delete")
    undo = page.get_by_role("button", name="Undo: restore fish-1.ply")
    undo.wait_for()
    service.store(made("fish", 1), "fish-1.ply")
    undo.click()
    expect(page.locator("#gallery-error")).to_contain_text("name")
    expect(undo).to_be_visible()


def test_a_shape_alone(visit: Visit) -> None:
    page = visit.open("browse")
    page.get_by_role("link", name="fish-1.ply", exact=True).click()
    page.wait_for_selector("#cards canvas[data-drawn]")
    assert page.title() == "fish-1.ply"
    assert "vertices" in page.inner_text("#cards")
    page.get_by_role("link", name="All shapes").click()
    page.wait_for_selector("#start-shapes li")


def test_a_comparison_as_a_page(visit: Visit, service: Running) -> None:
    shapes = service.client.get("/shapes", params={"tag": "fish"}).json()["shapes"]
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


def test_the_documentation_is_drawn(visit: Visit) -> None:
    visit.page.goto(f"{visit.here}/docs")
    visit.page.wait_for_selector(".opblock")
    assert visit.page.locator(".opblock").count() > 10


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
    context = browser.new_context()
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    faults: list[str] = []
    watch(page, faults)
    visit = Visit(page, str(locked.client.base_url))
    visit.open("browse")
    assert page.locator("#gallery li").count() == 0
    assert page.is_hidden("#signed-in")
    page.fill("#key", "isoshape_wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector("#sign-in-error:not([hidden])")
    assert "does not know this key" in page.inner_text("#sign-in-error")
    page.fill("#key", key)
    page.keyboard.press("Enter")
    page.wait_for_selector("#gallery li")
    assert page.get_by_role("link", name="Upload", exact=True).is_visible() == may_store
    page.get_by_role("button", name="Menu of fish-0.ply").click()
    delete = page.locator("#card-menu").get_by_role("button", name="Delete")
    assert (delete.count() == 1) == may_store
    # This service keeps no deleted shapes, so it asks.
    assert page.is_hidden("#deleted")
    if may_store:
        delete.click()
        assert "You cannot restore it." in page.inner_text("#deletion-text")
        page.locator("#deletion").get_by_role("button", name="Cancel").click()
        choose(page, "fish-0.ply", "Delete")
        page.keyboard.press("Escape")
        assert locked.client.get("/shapes").json()["total"] == 6
    page.keyboard.press("Escape")
    page.set_input_files("#find-file", file_in(tmp_path))
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(4)
    page.click("#sign-out")
    page.wait_for_selector("#sign-in:not([hidden])")
    assert page.locator("#gallery li").count() == 0
    # The wrong key is the only thing that went wrong.
    assert all("401" in fault for fault in faults)
    context.close()


def test_the_same_files_again_are_told_to_be_there(visit: Visit, tmp_path: Path) -> None:
    path = tmp_path / "fish-0.ply"
    path.write_bytes(made("fish", 0))
    page = visit.open("upload")
    page.set_input_files("#upload-files", [path])
    outcome = "0 stored, 1 already stored, 0 not stored, 0 waiting"
    expect(page.locator("#upload-status")).to_have_text(outcome)
