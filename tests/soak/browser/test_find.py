"""Finding what is alike: a file, three results in 3D, and which of their points correspond."""

from pathlib import Path

import numpy as np
import pytest

from core.gallery.bodies import make_body
from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.service.support import Running
from tests.soak.browser.support import Visit, drawn, file_in, hues, made, picture, settled


def verdict(result: dict) -> str:
    """The line that a result has on the page."""
    if result["likeness"] == "pose":
        return f"Another pose, {result['cc']:.3f}"
    percent = f"{100 * result['combined']:.0f} %"
    bounded = (
        "under 1 %" if result["combined"] < 0.01 else "over 99 %" if result["combined"] > 0.99 else percent
    )
    return f"{result['likeness'].capitalize()}: {bounded}"


def test_a_file_finds_the_three_most_alike(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    assert page.locator("#cards > li").count() == 4
    titles = page.locator("#cards h3").all_inner_texts()
    assert titles[0] == "fish-3.ply"
    assert [title.split(". ")[0] for title in titles[1:]] == ["1", "2", "3"]
    assert titles[1].split(". ")[1].startswith("fish-")
    asked = page.request.post(
        f"{visit.here}/query",
        multipart={
            "file": {"name": "q.ply", "mimeType": "x/y", "buffer": made("fish", 3)},
            "rank_by": "combined",
        },
    ).json()
    for number, result in enumerate(asked["results"], 1):
        one = page.locator("#cards > li").nth(number)
        assert one.locator(".likeness").inner_text() == verdict(result)
        assert one.locator(".scores").is_hidden()
        one.locator("summary").click()
        numbers = [float(value) for value in one.locator(".scores dd").all_inner_texts()[:4]]
        scores = [result[name] for name in ("cc", "ssd", "sim", "combined")]
        assert numbers == pytest.approx(scores, abs=5e-4)
    terms = page.locator(".scores-explained dt").all_text_contents()
    assert terms == [
        "Same part",
        "Mirror image",
        "Variant",
        "Another pose",
        "Similar",
        "Weak",
        "CC",
        "SSD",
        "sim",
        "combined",
    ]
    summary = page.inner_text("#results-summary")
    assert "6 of 6 stored shapes" in summary
    assert "sorted by combined" in summary


@pytest.mark.parametrize(
    ("factors", "line"),
    [
        ((1, 1, 1), "Same part"),
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
    path = tmp_path / "copy.ply"
    faces = mesh.faces if np.prod(factors) > 0 else mesh.faces[:, ::-1]
    path.write_bytes(write_mesh(Mesh(mesh.vertices * np.array(factors), faces), "ply"))
    page = visit.find(path)
    assert page.locator("#cards .likeness").first.inner_text() == line


def test_points_that_correspond_have_one_colour(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    page.evaluate("document.activeElement.blur()")
    canvases = page.locator("#cards canvas")
    for i in range(4):
        assert hues(picture(canvases.nth(i), tmp_path)) >= 4
    page.select_option("#paint", "plain")
    page.uncheck("#points")
    settled(page)
    for i in range(4):
        assert hues(picture(canvases.nth(i), tmp_path)) <= 1


def test_pointing_at_a_point_shows_its_partners(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    canvas = page.locator("#cards canvas").nth(1)
    canvas.scroll_into_view_if_needed()
    before = [picture(page.locator("#cards canvas").nth(i), tmp_path) for i in range(4)]
    box = canvas.bounding_box()
    assert box is not None
    # The middle of the picture is on the shape, and points are all over it.
    for step in range(30):
        page.mouse.move(box["x"] + box["width"] / 2 + step, box["y"] + box["height"] / 2)
        if "↔" in page.inner_text("#point-status"):
            break
    told = page.inner_text("#point-status")
    assert told.count("↔") == 3
    assert told.startswith("fish-3.ply: vertex ")
    settled(page)
    yellow = np.array([255.0, 212, 0])
    for i in range(4):
        after = picture(page.locator("#cards canvas").nth(i), tmp_path)
        assert (np.abs(after - yellow).max(axis=2) < 30).sum() > 20, i
        assert (np.abs(before[i] - yellow).max(axis=2) < 30).sum() < 20, i


def test_all_shapes_turn_together(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    canvases = page.locator("#cards canvas")
    canvases.first.scroll_into_view_if_needed()
    page.evaluate("document.activeElement.blur()")
    before = [picture(canvases.nth(i), tmp_path) for i in range(4)]
    box = canvases.nth(2).bounding_box()
    assert box is not None
    x, y = box["x"] + 20, box["y"] + 20
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y + 30, steps=4)
    page.mouse.up()
    settled(page)
    for i in range(4):
        assert np.abs(picture(canvases.nth(i), tmp_path) - before[i]).mean() > 2, i
    page.click("#reset-view")
    page.mouse.move(0, 0)
    page.evaluate("document.activeElement.blur()")
    settled(page)
    for i in range(4):
        assert np.abs(picture(canvases.nth(i), tmp_path) - before[i]).mean() < 0.5, i


def test_eigenmaps_go_from_blue_to_red_on_all(visit: Visit, tmp_path: Path) -> None:
    page = visit.find(file_in(tmp_path))
    page.uncheck("#points")
    maps = []
    # In the third coordinate one side of fish-3 has one sign only, and only the other side is seen.
    for number in ("1", "2"):
        page.select_option("#paint", number)
        settled(page)
        shown = [picture(page.locator("#cards canvas").nth(i), tmp_path) for i in range(4)]
        for each in shown:
            assert ((each[..., 0] - each[..., 2]) > 50).sum() > 50
            assert ((each[..., 2] - each[..., 0]) > 50).sum() > 50
        maps.append(shown)
    assert all(np.abs(one - two).mean() > 1 for one, two in zip(*maps, strict=True))


def test_a_stored_shape_finds_others_of_a_tag(visit: Visit) -> None:
    page = visit.open()
    page.locator("#find-filters summary").click()
    page.fill("#find-tags", "fish")
    page.get_by_role("link", name="Find similar to fish-0.ply").click()
    drawn(page, 3)
    titles = page.locator("#cards h3").all_inner_texts()
    assert titles[0] == "fish-0.ply"
    assert {title.split(". ")[1] for title in titles[1:]} == {"fish-1.ply", "fish-2.ply"}


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


def test_an_error_is_shown_in_the_services_words(visit: Visit, tmp_path: Path) -> None:
    bad = tmp_path / "bad.off"
    bad.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    visit.expected = ["422", "400", "415"]
    page = visit.open()
    page.set_input_files("#find-file", bad)
    page.wait_for_selector("#find-error:not([hidden])")
    told = page.request.post(
        f"{visit.here}/query",
        multipart={"file": {"name": "bad.off", "mimeType": "x/y", "buffer": bad.read_bytes()}},
    ).json()
    assert told["detail"] in page.inner_text("#find-error")
    assert page.is_hidden("#results")
    # A good file afterwards takes it away, and the next error takes away its results.
    page.set_input_files("#find-file", file_in(tmp_path))
    drawn(page, 4)
    assert page.is_hidden("#find-error")
    page.set_input_files("#find-file", bad)
    page.wait_for_selector("#find-error:not([hidden])")
    assert page.is_hidden("#results")
    assert page.is_hidden("#find-query")


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}, {"color_scheme": "light"}], indirect=True)
def test_dark_and_light(visit: Visit, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    page = visit.open()
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    shown = picture(page.locator("body > header"), tmp_path)
    dark = request.node.callspec.params["visit"]["color_scheme"] == "dark"
    assert (np.median(shown) < 60) == dark, ground
