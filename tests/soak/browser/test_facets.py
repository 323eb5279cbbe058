"""Facets of Browse, completion of tags, and the map's dots and sheet of pictures."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.service.support import Running, small_file, working_in
from tests.soak.browser.support import NAMES, PHONE, Visit, held_back, made, serious, stored

MANY = 70
"""More shapes than a page of the list has."""


def facets(page: Page, title: str) -> dict[str, int]:
    """The values of a facet with their counts."""
    links = page.get_by_role("list", name=title, exact=True).get_by_role("link")
    expect(links.first).to_be_visible()
    pairs = [link.locator("span").all_inner_texts() for link in links.all()]
    return {value: int(count) for value, count in pairs}


def choose_facet(page: Page, title: str, value: str) -> None:
    links = page.get_by_role("list", name=title, exact=True).get_by_role("link")
    links.filter(has=page.get_by_text(value, exact=True)).click()


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, PHONE], indirect=True, ids=["desktop", "phone"])
def test_facets_count_the_shapes_and_narrow_the_list(visit: Visit, service: Running) -> None:
    with working_in(service, "castings") as other:
        other.store(made("fish", 1), "cast.ply", tags="fish")
        service.store(small_file(1), "small.off", tags="fish,other")
        page = visit.open("browse")
        if page.locator("#facets[open]").count() == 0:
            page.locator("#facets summary").click()
        assert facets(page, "Tags") == {"made": 6, "fish": 4, "glasses": 3, "other": 1}
        assert facets(page, "Format") == {"ply": 6, "off": 1}
        assert facets(page, "Collection") == {"castings": 1, "default": 7}
        assert serious(page) == []
        shown = page.locator("#gallery .name")
        for band, count in facets(page, "Longest side").items():
            least, most = map(float, band.split(" – "))
            choose_facet(page, "Longest side", band)
            expect(shown).to_have_count(count)
            longest = {shape["name"]: shape["facts"]["bounding_box"][0] for shape in stored(service)}
            assert all(least <= longest[name] <= most for name in shown.all_inner_texts())
            # The same link takes it back.
            choose_facet(page, "Longest side", band)
            expect(shown).to_have_count(7)
        choose_facet(page, "Tags", "fish")
        expect(shown).to_have_count(4)
        expect(page.locator("#facets a[aria-current]")).to_contain_text(["fish", "default"])
        assert facets(page, "Tags") == {"fish": 4, "made": 3, "other": 1}
        choose_facet(page, "Format", "off")
        expect(shown).to_have_text(["small.off"])
        assert "file_format=off" in page.url
        # Back shows what was before, and the filters of the form are the same.
        page.go_back()
        expect(shown).to_have_count(4)
        assert page.input_value("#gallery-tags") == "fish"
        choose_facet(page, "Collection", "castings")
        page.wait_for_url("**collection=castings**")
        expect(shown).to_have_text(["cast.ply"])
        # The page asks for nothing of a shape that is gone.
        page.goto("about:blank")
        other.clear()
        assert other.client.delete("/collections/castings").status_code == 204


def test_completion_knows_all_tags(visit: Visit, service: Running) -> None:
    with working_in(service, "many") as other:
        for number in range(MANY):
            other.store(small_file(number), f"{number}.off", tags=f"tag-{number:02d}")
        page = visit.open("upload", collection="many")
        options = page.locator("#tags option")

        def offered() -> list[str | None]:
            return [option.get_attribute("value") for option in options.all()]

        # No card of the shape is shown.
        page.locator("#upload-tags").press_sequentially("TAG-6")
        expect(options).to_have_count(10)
        assert offered() == [f"tag-6{digit}" for digit in range(10)]
        page.fill("#upload-tags", "new, tag-69")
        expect(options).to_have_count(1)
        assert offered() == ["new, tag-69"]
        shape = stored(other, name="3.off")[0]
        page.goto(f"{visit.here}/shapes/{shape['id']}/view?collection=many")
        page.get_by_role("button", name="Edit").click()
        page.get_by_label("Tags, separated by commas").fill("tag-42")
        expect(options).to_have_attribute("value", "tag-42")
        # The page asks for nothing of a shape that is gone.
        page.goto("about:blank")
        other.clear()
        assert other.client.delete("/collections/many").status_code == 204


def test_the_map_has_dots_at_once_and_one_sheet_of_pictures(visit: Visit, service: Running) -> None:
    asked: list[str] = []
    visit.page.on("request", lambda request: asked.append(request.url))
    held = held_back(visit.page, "**/map/thumbnails.png*")
    page = visit.open("map")
    links, map_list = page.locator("#map a"), page.locator("#map")
    expect(links).to_have_count(6)
    # A dot in the middle of each cell, and nothing at its corner.
    for link in links.all():
        cell = np.asarray(Image.open(BytesIO(link.screenshot())).convert("RGB")).astype(float)
        middle, corner = cell[cell.shape[0] // 2, cell.shape[1] // 2], cell[2, 2]
        assert np.abs(middle - corner).max() > 60
    held[0].continue_()
    expect(map_list).to_have_attribute("data-missing", "0")
    # Each cell shows the shape that it leads to.
    alone = {}
    for shape in stored(service):
        answer = service.client.get(f"/shapes/{shape['id']}/thumbnail.png", params={"size": "128"})
        alone[shape["id"]] = (
            np.asarray(Image.open(BytesIO(answer.content)).convert("RGBA").getchannel("A")).astype(float)
            / 255
        )
    for link in links.all():
        cell = Image.open(BytesIO(link.screenshot())).convert("RGB").resize((128, 128))
        pixels = np.asarray(cell).astype(float)
        seen = (np.abs(pixels - pixels[2, 2]).max(axis=2) > 20).astype(float)
        apart = {shape_id: np.abs(seen - own).mean() for shape_id, own in alone.items()}
        assert min(apart, key=lambda shape_id: apart[shape_id]) == link.get_attribute("data-shape")
    assert [url for url in asked if "thumbnail.png" in url] == []
    assert len([url for url in asked if "thumbnails.png" in url]) == len(held)


def test_a_map_whose_shapes_change_meanwhile_is_loaded_again(visit: Visit, service: Running) -> None:
    held = held_back(visit.page, "**/map/thumbnails.png*")
    page = visit.open("map")
    expect(page.locator("#map a")).to_have_count(len(NAMES))
    service.store(made("fish", 4), "fish-4.ply")
    with page.expect_request("**/map/thumbnails.png*"):
        held[0].continue_()
    expect(page.locator("#map a")).to_have_count(len(NAMES) + 1)
    held[1].continue_()
    expect(page.locator("#map")).to_have_attribute("data-missing", "0")
