"""Finding what is alike: a file, three results in 3D, and which of their points correspond."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from core.gallery.bodies import make_body
from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.dense.solids import plate
from tests.core.shapes import box, subdivided
from tests.service.support import Running, query
from tests.soak.browser.support import (
    Visit,
    box_of,
    drawn,
    file_in,
    hues,
    made,
    paint,
    picture,
    pictures,
    settled,
    stored,
)


def verdict(result: dict) -> str:
    """The line that a result has on the page."""
    if result["likeness"] == "pose":
        return "Another pose"
    probability = result["combined"]
    bounded = "under 1 %" if probability < 0.01 else "over 99 %" if probability > 0.99 else None
    return f"{result['likeness'].capitalize()}: {bounded or f'{100 * probability:.0f} %'}"


def test_a_file_finds_the_three_most_alike(visit: Visit, service: Running, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    answer = query(service.client, made("fish", 3), "q.ply", rank_by="combined").json()
    names = [result["shape"]["name"] for result in answer["results"]]
    assert names[0].startswith("fish-")
    titles = [f"{number}. {name}" for number, name in enumerate(names, 1)]
    assert page.locator("#cards h3").all_inner_texts() == ["fish-3.ply", *titles]
    for number, result in enumerate(answer["results"], 1):
        card = page.locator("#cards > li").nth(number)
        assert card.locator(".likeness").inner_text() == verdict(result)
        assert card.locator(".scores").is_hidden()
        card.locator("summary").click()
        numbers = [float(value) for value in card.locator(".scores dd").all_inner_texts()[:4]]
        scores = [result[name] for name in ("cc", "ssd", "sim", "combined")]
        assert numbers == pytest.approx(scores, abs=5e-4)
    verdicts = ["Same part", "Mirror image", "Variant", "Another pose", "Similar", "Weak"]
    terms = page.locator(".scores-explained dt").all_text_contents()
    assert terms == [*verdicts, "CC", "SSD", "sim", "combined", "contextual"]
    summary = page.inner_text("#results-summary")
    assert "6 of 6 stored shapes" in summary
    assert "sorted by combined: the neighbours of most candidates are not known yet." in summary


@pytest.mark.parametrize(
    ("factors", "line"),
    [
        ((1, 1, 1), "Same part"),
        ((1 / 1.029, 1 / 1.029, 1 / 1.029), "Same part, 1.029 times as large"),
        ((2, 2, 2), "Same part, 0.5 times as large"),
        ((1, 1, -1), "Mirror image"),
        ((-0.5, 0.5, 0.5), "Mirror image, 2 times as large"),
    ],
)
def test_one_line_says_by_what_a_copy_is_alike(
    visit: Visit, service: Running, tmp_path: Path, factors: tuple[float, ...], line: str
) -> None:
    mesh = make_body("hand").posed(0)
    service.store(write_mesh(mesh, "ply"), "hand.ply")
    faces = mesh.faces if np.prod(factors) > 0 else mesh.faces[:, ::-1]
    copy = write_mesh(Mesh(mesh.vertices * np.array(factors), faces), "ply")
    page = visit.find(file_in(tmp_path, copy))
    assert page.locator("#cards .likeness").first.inner_text() == line


def test_sizes_are_on_every_card_with_the_box_of_the_files_axes_and_the_unit(
    visit: Visit, service: Running, tmp_path: Path
) -> None:
    solid = subdivided(subdivided(box(60.0, 50.0, 40.0)))
    # A quarter of a half turn about z: x and y extend over (60 + 50) / sqrt(2).
    half = np.sqrt(0.5)
    turned = Mesh(solid.vertices @ np.array([[half, half, 0], [-half, half, 0], [0, 0, 1]]), solid.faces)
    service.store(write_mesh(solid, "3mf"), "straight.3mf")
    service.store(write_mesh(turned, "off"), "turned.off")
    straight, askew = "60 × 50 × 40 mm", "60 × 50 × 40, no unit (x, y, z: 77.78 × 77.78 × 40)"
    page = visit.open("browse", name="t", sort="name")
    cards = page.locator("#gallery li")
    expect(cards.filter(has_text="straight.3mf").locator(".size")).to_have_text(straight)
    expect(cards.filter(has_text="turned.off").locator(".size")).to_have_text(askew)
    page = visit.find(file_in(tmp_path, write_mesh(turned, "off"), "query.off"))
    results = page.locator("#cards li")
    expect(results.first).to_contain_text(askew)
    expect(results.filter(has_text="straight.3mf")).to_contain_text(straight)
    table = results.filter(has_text="straight.3mf")
    table.locator("summary").click()
    told = dict(
        zip(*(table.locator(f".scores {part}").all_inner_texts() for part in ("dt", "dd")), strict=True)
    )
    assert (told["least box"], told["along x, y, z"]) == (straight, straight)
    assert (told["area"], told["volume"]) == ("14800 mm²", "120000 mm³")
    page.get_by_role("link", name="Find similar to turned.off").click()
    expect(page.locator("#find-name")).to_have_text("turned.off")
    expect(results.first).to_contain_text(askew)


def test_colours_show_points_that_correspond_or_eigenmaps(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    assert all(hues(shown) >= 4 for shown in pictures(page))
    page.uncheck("#points")
    paint(page, "plain")
    assert all(hues(shown) <= 1 for shown in pictures(page))
    maps = []
    # In the third coordinate one side of fish-3 has one sign only, and only the other side is seen.
    for number in ("1", "2"):
        paint(page, number)
        maps.append(pictures(page))
        for shown in maps[-1]:
            assert ((shown[..., 0] - shown[..., 2]) > 50).sum() > 50
            assert ((shown[..., 2] - shown[..., 0]) > 50).sum() > 50
    assert all(np.abs(one - two).mean() > 1 for one, two in zip(*maps, strict=True))


def test_pointing_at_a_point_shows_its_partners(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    before = pictures(page)
    canvas = page.locator("#cards canvas").nth(1)
    canvas.scroll_into_view_if_needed()
    box = box_of(canvas)
    # The middle of the picture is on the shape, and points are all over it.
    for step in range(30):
        page.mouse.move(box["x"] + box["width"] / 2 + step, box["y"] + box["height"] / 2)
        if "↔" in page.inner_text("#point-status"):
            break
    told = page.inner_text("#point-status")
    assert told.count("↔") == 3
    assert told.startswith("fish-3.ply: vertex ")
    settled(page)
    yellow = [(np.abs(shown - [255, 212, 0]).max(axis=2) < 30).sum() for shown in (*before, *pictures(page))]
    assert max(yellow[:4]) < 20 < min(yellow[4:])


def test_all_shapes_turn_together(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    before = pictures(page)
    canvas = page.locator("#cards canvas").nth(2)
    canvas.scroll_into_view_if_needed()
    box = box_of(canvas)
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 140, box["y"] + 50, steps=4)
    page.mouse.up()
    settled(page)
    assert all(np.abs(a - b).mean() > 2 for a, b in zip(pictures(page), before, strict=True))
    page.click("#reset-view")
    page.mouse.move(0, 0)
    settled(page)
    assert all(np.abs(a - b).mean() < 0.5 for a, b in zip(pictures(page), before, strict=True))


def test_progress_is_shown_while_a_file_goes_and_is_worked_on(visit: Visit, tmp_path: Path) -> None:
    page = visit.open()
    page.evaluate(
        """() => {
            window.seen = [];
            const part = document.getElementById("find-progress");
            const stage = document.getElementById("find-stage");
            const look = () => part.hidden || window.seen.push(stage.textContent);
            new MutationObserver(look).observe(part, { subtree: true, childList: true, attributes: true });
        }"""
    )
    page.set_input_files("#find-file", file_in(tmp_path))
    drawn(page, 4)
    seen = page.evaluate("window.seen")
    assert "Uploading" in seen
    assert seen[-1] == "Computing and comparing"
    assert page.is_hidden("#find-progress")


def test_an_error_is_shown_in_the_services_words(visit: Visit, service: Running, tmp_path: Path) -> None:
    data = b"OFF\n3 1 0\n0 0 0\n1 0 0\n"
    bad = file_in(tmp_path, data, "bad.off")
    visit.expected = ["422"]
    page = visit.open()
    page.set_input_files("#find-file", bad)
    detail = query(service.client, data, "bad.off").json()["detail"]
    expect(page.locator("#find-error")).to_contain_text(detail)
    assert page.is_hidden("#results")
    # A good file afterwards takes it away, and the next error takes away its results.
    page.set_input_files("#find-file", file_in(tmp_path))
    drawn(page, 4)
    assert page.is_hidden("#find-error")
    page.set_input_files("#find-file", bad)
    page.wait_for_selector("#find-error:not([hidden])")
    assert page.is_hidden("#results")
    assert page.is_hidden("#find-query")


def test_a_search_takes_the_filters_of_the_page(visit: Visit, service: Running, tmp_path: Path) -> None:
    whole = plate([(4, 4)])
    service.store(write_mesh(whole, "ply"), "plate.ply", metadata='{"source": "cad"}')
    service.store(write_mesh(Mesh(25.4 * whole.vertices, whole.faces), "ply"), "inch.ply")
    turned = write_mesh(Mesh(whole.vertices[:, [1, 0, 2]] * [1, 1, -1], whole.faces), "ply")
    page = visit.find(file_in(tmp_path, turned, "query.ply"))

    def search(field: str, text: str) -> None:
        page.fill(field, text)
        page.keyboard.press("Enter")

    page.locator("#find-filters summary").click()
    search("#find-metadata", "source=cad")
    drawn(page, 2)
    titles = page.locator("#cards h3")
    assert titles.nth(1).inner_text() == "1. plate.ply"
    search("#find-metadata", "")
    drawn(page, 4)
    expect(titles).to_contain_text(["query.ply", "plate.ply", "inch.ply", ""])
    page.get_by_label("Same size as the query").check()
    expect(page.locator("#cards")).not_to_contain_text("inch.ply")
    expect(titles.nth(1)).to_have_text("1. plate.ply")
    page.get_by_label("Same size as the query").uncheck()
    expect(titles.nth(2)).to_have_text("2. inch.ply")
    search("#find-cc", "0.999")
    drawn(page, 3)
    for card in page.locator("#cards > li").all()[1:]:
        card.locator("summary").click()
        assert float(card.locator("dd").first.inner_text()) >= 0.999
        assert "×" in card.inner_text()
    page.fill("#find-cc", "")
    part = page.get_by_label("The query is a part of a shape")
    part.check()
    expect(page.locator("#find-filter-count")).to_have_text("(1)")
    assert "partial=true" in page.url
    drawn(page, 4)
    part.uncheck()
    # Nothing has this length, but something has it in inches.
    length = 25.4**2 * max(stored(service, name="plate")[0]["facts"]["bounding_box"])
    search("#find-length", f"{0.99 * length}..{1.01 * length}")
    expect(page.locator("#results-warnings")).to_contain_text("25.4 times")


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, {"color_scheme": "light"}], indirect=True)
def test_dark_and_light(visit: Visit, request: pytest.FixtureRequest) -> None:
    shown = picture(visit.open().locator("body > header"))
    dark = request.node.callspec.params["visit"]["color_scheme"] == "dark"
    assert (np.median(shown) < 60) == dark
