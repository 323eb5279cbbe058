"""The library: a folder's state, a loss that is confirmed, and what is missing."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.service.sources.support import Library, put
from tests.service.support import Running, small_file
from tests.soak.browser.support import PHONE, Visit, serious


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_a_lost_folder_is_told_of_until_a_person_confirms(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    root = tmp_path / "models"
    put(root / "a.off", small_file(1))
    put(root / "bad.off", b"no mesh")
    put(root / "cut.zip", b"PK\3\4")
    with Library.of(service, root) as library:
        page = visit.open("library")
        row = page.locator("#sources > li")
        expect(row).to_contain_text("1 file, up to date")
        expect(row.locator(".path")).to_have_text(str(root))
        row.get_by_text("1 refused").click()
        expect(row.locator(".files li")).to_contain_text("bad.off: ")
        expect(row.locator(".warning")).to_contain_text("cut.zip is left out: ")
        assert serious(page) == []

        root.rename(tmp_path / "away")
        page.get_by_role("button", name="Rescan").click()
        expect(row.locator(".warning")).to_contain_text("Offline: the folder cannot be listed")
        assert serious(page) == []
        page.get_by_role("button", name="Confirm the loss").click()
        row.get_by_text("1 missing").click()
        expect(row.locator(".files li")).to_have_text("a.off")
        expect(row).to_contain_text("0 files, up to date")
        (tmp_path / "away").rename(root)
        library.rescan()
        page.reload()
        expect(row).to_contain_text("1 file, up to date")
        page.goto(f"{visit.here}/shapes/{library.shapes()['a.off']}/view")
        expect(page.locator("#paths dd")).to_have_text(f"{root}/a.off")
        assert serious(page) == []
        page.get_by_role("link", name="Library").click()
        # A press waits for the scan that it begins.
        put(root / "b.off", small_file(2))
        put(root / "copy of b.off", small_file(2))
        page.get_by_role("button", name="Rescan").click()
        expect(row).to_contain_text("3 files, up to date")
        row.get_by_text("Files that are there more than once").click()
        link = row.locator(".files a")
        expect(link).to_have_text(re.compile(r"^(b.off = copy of b.off|copy of b.off = b.off)$"))
        expect(link).to_have_attribute("href", re.compile(f"/shapes/{library.shapes()['b.off']}/view$"))
        assert serious(page) == []
        # The first of two equal files, in a folder, and a shape that no folder has.
        put(root / "a folder" / "b.off", small_file(2))
        library.rescan()
        page = visit.open("browse", sort="newest")
        cards = page.locator("#gallery li")
        expect(cards.filter(has_text="b.off").locator(".about")).to_contain_text(f"{root}/a folder · ")
        expect(cards.filter(has_text="fish-0.ply").locator(".about")).not_to_contain_text(" · ")
        assert serious(page) == []
        visit.open("library")
        expect(row).to_contain_text("4 files, up to date")
    page.reload()
    expect(page.locator("#library-status")).to_contain_text("No folders yet.")
