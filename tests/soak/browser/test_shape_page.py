"""The page of a stored shape: its record, its file in other formats, and its text, which is edited there."""

from pathlib import Path

from playwright.sync_api import Page, expect

from tests.service.support import Running, relate
from tests.soak.browser.support import Visit, box_of, made, serious

METADATA = '{"source": "scan", "year": 2024, "code": "007", "deep": {"a": [1, null]}}'


def terms(page: Page, where: str) -> dict[str, str]:
    """The values of a list of terms."""
    names, values = (page.locator(f"{where} {part}").all_inner_texts() for part in ("dt", "dd"))
    return dict(zip(names, values, strict=True))


def opened(visit: Visit, shape: dict) -> Page:
    visit.page.goto(f"{visit.here}/shapes/{shape['id']}/view")
    visit.page.wait_for_selector("#cards canvas[data-drawn]")
    return visit.page


def test_a_shape_is_edited_on_its_own_page(visit: Visit, service: Running) -> None:
    shape = service.store(made("fish", 4), "fish-4.ply", tags="fish,new", metadata=METADATA)
    card = visit.open("browse", q="fish-4").locator("#gallery li")
    expect(card.locator(".about")).to_contain_text(
        '· source: scan · year: 2024 · code: 007 · deep: {"a":[1,null]}'
    )
    card.locator(".name").click()
    page = visit.page
    page.wait_for_selector("#cards canvas[data-drawn]")
    told = terms(page, "#facts")
    assert (told["collection"], told["file"].partition(",")[0]) == ("default", "PLY")
    assert told["faces"] == f"{shape['facts']['faces']:,}"
    parts = "{month: 'short', day: 'numeric', year: 'numeric', hour: 'numeric', minute: '2-digit'}"
    stored = page.evaluate(f"time => new Date(time).toLocaleString('en', {parts})", shape["created_at"])
    assert told["stored"] == stored
    assert terms(page, "#metadata") == {
        "source": "scan",
        "year": "2024",
        "code": "007",
        "deep": '{"a":[1,null]}',
    }
    assert page.locator("#shape-tags a").all_inner_texts() == ["fish", "new"]
    page.get_by_role("button", name="Edit").click()
    assert serious(page) == []
    page.get_by_label("Name").fill("renamed.ply")
    page.get_by_label("Tags, separated by commas").fill("fish, checked")
    page.get_by_label("Value").nth(1).fill("2025")
    page.get_by_role("button", name="Remove source").click()
    page.get_by_role("button", name="Add an entry").click()
    page.keyboard.type("fits")
    page.keyboard.press("Tab")
    page.keyboard.type("true")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#title")).to_have_text("renamed.ply")
    assert page.title() == "renamed.ply"
    expect(page.locator("#cards h3")).to_have_text("renamed.ply")
    expect(page.get_by_role("img", name="renamed.ply in 3D.")).to_be_visible()
    expect(page.locator("#edit")).to_be_hidden()
    read = service.client.get(f"/shapes/{shape['id']}").json()
    assert (read["name"], read["tags"]) == ("renamed.ply", ["fish", "checked"])
    # What was not edited is what it was, and no text has become a number.
    assert read["metadata"] == {"year": 2025, "code": "007", "deep": {"a": [1, None]}, "fits": True}
    assert terms(page, "#metadata")["fits"] == "true"
    # What the service refuses stays in the form, with the reason.
    visit.expected = ["422"]
    page.get_by_role("button", name="Edit").click()
    page.get_by_label("Tags, separated by commas").fill("t" * 65)
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#edit-error")).to_contain_text("tags")
    page.get_by_role("button", name="Cancel").click()
    assert service.client.get(f"/shapes/{shape['id']}").json() == read
    page.locator("#shape-tags").get_by_role("link", name="checked").click()
    expect(page.locator("#gallery .name")).to_have_text(["renamed.ply"])


def test_a_shape_is_downloaded_in_any_format_and_searched_with(visit: Visit, service: Running) -> None:
    shape = service.client.get("/shapes", params={"name": "fish-0"}).json()["shapes"][0]
    page = opened(visit, shape)
    # The picture comes at once after the name.
    assert box_of(page.locator("#cards canvas"))["y"] < 130
    formats = service.client.get("/version").json()["formats"]
    offered = [option.get_attribute("value") for option in page.locator("#format option").all()]
    written = [each["name"] for each in formats if each["written"] and each["name"] != "ply"]
    assert offered == ["", *written]
    for choice, name in (("", "fish-0.ply"), ("stl", "fish-0.ply.stl")):
        page.select_option("#format", choice)
        with page.expect_download() as download:
            page.get_by_role("link", name="Download").click()
        assert download.value.suggested_filename == name
        parameters = {"format": choice} if choice else {}
        same = service.client.get(f"/shapes/{shape['id']}/file", params=parameters).content
        assert Path(download.value.path()).read_bytes() == same
    page.get_by_role("link", name="Find similar").click()
    expect(page.locator("#find-name")).to_have_text("fish-0.ply")


def test_similar_shapes_suggest_tags_and_a_person_adds_them(visit: Visit, service: Running) -> None:
    tagged = service.store(made("fish", 4), "fish-4.ply", tags="swims", metadata='{"fins": 7}')
    shape = service.store(made("fish", 5), "fish-5.ply")
    for each in service.client.get("/shapes").json()["shapes"]:
        if each["name"].startswith("fish-") and each["id"] not in (tagged["id"], shape["id"]):
            service.client.patch(f"/shapes/{each['id']}", json={"tags": ["swims"]})
    relate(service)
    page = opened(visit, shape)
    suggested = page.locator("#suggested li")
    expect(suggested).to_have_count(1)
    expect(suggested).to_contain_text("swims")
    expect(suggested.get_by_role("link", name="fish-4.ply")).to_have_attribute(
        "href", f"{visit.here}/shapes/{tagged['id']}/view"
    )
    assert serious(page) == []
    assert service.client.get(f"/shapes/{shape['id']}").json()["tags"] == []
    page.get_by_role("button", name="Add swims").click()
    expect(page.locator("#shape-tags a")).to_have_text(["swims"])
    expect(page.locator("#suggestions")).to_be_hidden()
    assert service.client.get(f"/shapes/{shape['id']}").json()["tags"] == ["swims"]
