"""Browsing: filters, order, menus, deletion, and the work of scrolling over ten thousand shapes."""

import json
from bisect import bisect
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect
from sqlalchemy import insert, select

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.storage.database import next_revision
from service.storage.tables import ShapeRow
from tests.core.dense.solids import plate
from tests.service.support import Running, relate, serving, settings_in
from tests.soak.browser.support import NAMES, Visit, choose, made, show, stored, visiting

MANY = 10_000
MOST = {"elements styled": 1000, "boxes laid out": 1500, "boxes": 3000}
"""Most work of a task while scrolling: about two windows of cards. All shapes have 160,000 elements."""


def names(page: Page) -> list[str]:
    return page.locator("#gallery .name").all_text_contents()


def test_similar_shapes_are_one_card(visit: Visit, service: Running) -> None:
    relate(service)
    families = service.client.get("/families").json()["families"]
    assert families
    page = visit.open("browse")
    group = page.get_by_label("Group similar shapes")
    group.check()
    cards = page.locator("#gallery > ul > li")
    expect(cards).to_have_count(len(families))
    noun = "group" if len(families) == 1 else "groups"
    expect(page.locator("#gallery-status")).to_have_text(f"{len(families)} {noun} of similar shapes")
    first, *others = [shape["name"] for shape in families[0]["shapes"]]
    expect(cards.first.locator("> .name")).to_have_text(first)
    page.get_by_role("checkbox", name=f"Select {first}").check()
    page.get_by_role("button", name="Select all that match").click()
    members = sum(len(family["shapes"]) for family in families)
    expect(page.locator("#selection-count")).to_have_text(f"{members} selected")
    cards.first.get_by_text(f"{len(others)} more like this").click()
    expect(cards.first.locator("details .name")).to_have_text(others)
    page.reload()
    expect(cards).to_have_count(len(families))
    group.uncheck()
    expect(page.locator("#gallery .name")).to_have_count(len(NAMES))


def test_the_list_has_an_order_and_filters(visit: Visit, service: Running) -> None:
    for name, scale in {"small.ply": 1.0, "large.ply": 10.0}.items():
        mesh = plate([(4, 4)])
        data = write_mesh(Mesh(scale * mesh.vertices, mesh.faces), "ply")
        service.store(data, name, metadata='{"source": "cad"}')
    length = max(stored(service, name="large")[0]["facts"]["bounding_box"])
    page = visit.open("browse")
    shown = page.locator("#gallery .name")
    expect(shown).to_have_text([shape["name"] for shape in stored(service)])
    page.select_option("#gallery-sort", "newest")
    expect(shown.first).to_have_text("large.ply")
    page.select_option("#gallery-sort", "name")
    expect(shown).to_have_text(sorted([*NAMES, "small.ply", "large.ply"]))
    page.fill("#gallery-words", "FISH-")
    expect(shown).to_have_count(3)
    page.fill("#gallery-words", "")
    page.locator("#gallery-filters summary").click()
    page.fill("#gallery-tags", "no such tag")
    expect(page.locator("#gallery-status")).to_have_text("No stored shape matches.")
    expect(shown).to_have_count(0)
    page.fill("#gallery-tags", "")
    page.fill("#gallery-metadata", "source=cad")
    expect(shown).to_have_text(["large.ply", "small.ply"])
    page.fill("#gallery-length", f"{0.9 * length:.3f}..{1.1 * length:.3f}")
    expect(shown).to_have_text(["large.ply"])
    expect(page.locator("#gallery-filter-count")).to_have_text("(2)")
    assert "metadata=source%3Dcad" in page.url
    page.reload()
    expect(shown).to_have_text(["large.ply"])
    visit.expected = ["422"]
    page.locator("#gallery-filters summary").click()
    page.fill("#gallery-length", "10-20")
    expect(page.locator("#gallery-error")).to_contain_text("length: ")


def test_a_shape_is_downloaded_opened_and_shown_alone(visit: Visit) -> None:
    page = visit.open("browse")
    with page.expect_download() as download:
        choose(page, "fish-1.ply", "Download")
    assert download.value.suggested_filename == "fish-1.ply"
    assert Path(download.value.path()).read_bytes() == made("fish", 1)
    page.keyboard.press("Escape")
    expect(page.locator("#card-menu")).to_be_hidden()
    choose(page, "fish-2.ply", "Open")
    page.wait_for_selector("#cards canvas[data-drawn]")
    assert page.title() == page.inner_text("#title") == "fish-2.ply"
    expect(page.locator("#facts")).to_contain_text("vertices")
    page.get_by_role("link", name="Browse", exact=True).click()
    page.wait_for_selector("#gallery li")


def test_a_deleted_shape_is_restored(visit: Visit, service: Running) -> None:
    before = stored(service)
    page = visit.open("browse")
    # The picture of a shape that is deleted meanwhile is not found.
    page.wait_for_load_state("networkidle")
    for name in ("fish-1.ply", "glasses-2.ply", "fish-2.ply"):
        choose(page, name, "Delete")
        told = f"{name} was deleted. You can restore it within 7 days."
        expect(page.locator("#undo")).to_contain_text(told)
    page.get_by_role("button", name="Undo: restore fish-2.ply").click()
    expect(page.locator("#undo")).to_have_text("fish-2.ply was restored.")
    # A restored shape is listed where it was.
    left = [shape["name"] for shape in before if shape["name"] not in {"fish-1.ply", "glasses-2.ply"}]
    expect(page.locator("#gallery .name")).to_have_text(left)
    # Others may have been deleted before; the latest comes first.
    page.locator("#deleted summary").click()
    rows, count = page.locator("#deleted-list li"), page.locator("#deleted-count")
    expect(rows.nth(0)).to_contain_text("glasses-2.ply")
    expect(rows.nth(1)).to_contain_text("fish-1.ply")
    total = service.client.get("/deleted").json()["total"]
    expect(count).to_have_text(str(total))
    page.get_by_role("button", name="Restore glasses-2.ply").first.click()
    expect(page.locator("#gallery li")).to_have_count(5)
    expect(rows.nth(0)).to_contain_text("fish-1.ply")
    # For good, if that is confirmed.
    erase = page.get_by_role("button", name="Delete fish-1.ply for good").first
    erase.click()
    page.keyboard.press("Escape")
    expect(count).to_have_text(str(total - 1))
    erase.click()
    page.locator("#deletion").get_by_role("button", name="Delete").click()
    expect(count).to_have_text(str(total - 2))
    expect(page.locator("#undo")).to_have_text("fish-1.ply was deleted for good.")
    assert service.client.get("/deleted").json()["total"] == total - 2
    kept = [shape for shape in before if shape["name"] != "fish-1.ply"]
    keys = ("id", "tags", "sha256")
    assert [[shape[key] for key in keys] for shape in stored(service)] == [
        [shape[key] for key in keys] for shape in kept
    ]


def test_a_deletion_for_good_is_confirmed_and_offers_no_undo(browser: Browser, tmp_path: Path) -> None:
    """By a service that keeps no deleted shapes."""
    with serving(settings_in(tmp_path, workers=1, undo_days=0)) as running:
        for number in (1, 2):
            running.store(made("fish", number), f"fish-{number}.ply")
        with visiting(browser, running) as visit:
            page = visit.open("browse")
            # The picture of a shape that is deleted meanwhile is not found.
            page.wait_for_load_state("networkidle")
            listed = page.locator("#gallery .name")
            choose(page, "fish-1.ply", "Delete")
            page.locator("#deletion").wait_for()
            page.keyboard.press("Escape")
            expect(listed).to_have_count(2)
            choose(page, "fish-1.ply", "Delete")
            page.locator("#deletion").get_by_role("button", name="Delete").click()
            expect(listed).to_have_text(["fish-2.ply"])
            expect(page.get_by_role("button", name="Undo")).to_have_count(0)
            expect(page.locator("#deleted")).to_be_hidden()
        assert running.client.get("/deleted").json()["total"] == 0
        assert [shape["name"] for shape in stored(running)] == ["fish-2.ply"]


def test_the_page_names_shapes_that_cannot_be_restored(visit: Visit, service: Running) -> None:
    visit.expected = ["409"]
    page = visit.open("browse")
    # The picture of a shape that is deleted meanwhile is not found.
    page.wait_for_load_state("networkidle")
    choose(page, "fish-1.ply", "Delete")
    undo = page.get_by_role("button", name="Undo: restore fish-1.ply")
    undo.wait_for()
    service.store(made("fish", 1), "fish-1.ply")
    undo.click()
    expect(page.locator("#gallery-error")).to_contain_text("name")
    expect(undo).to_be_visible()


def test_a_shape_deleted_while_the_list_is_loaded_again_does_not_stay(visit: Visit) -> None:
    page = visit.open("browse")
    # The picture of a shape that is deleted meanwhile is not found.
    page.wait_for_load_state("networkidle")
    held: list[Route] = []
    page.route(
        "**/shapes/*",
        lambda route: held.append(route) if route.request.method == "DELETE" else route.continue_(),
    )
    with page.expect_request(lambda request: request.method == "DELETE"):
        choose(page, "fish-1.ply", "Delete")
    page.fill("#gallery-words", "fish")
    expect(page.locator("#gallery li")).to_have_count(3)
    held[0].continue_()
    expect(page.locator("#gallery li")).to_have_count(2)
    assert "fish-1.ply" not in names(page)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with ten thousand shapes, which share the files of a few."""
    with serving(settings_in(tmp_path_factory.mktemp("many"), workers=1)) as running:
        for label in ("fish", "glasses"):
            running.store(made(label, 0), f"{label}.ply")
        with running.container.database.write() as session:
            rows = session.execute(select(ShapeRow.__table__)).mappings().all()
            revision = next_revision(session)
            copies = []
            for number in range(2, MANY):
                name = f"part-{number:05d}.ply"
                row = {key: value for key, value in rows[number % 2].items() if key != "number"}
                row |= {"id": f"00000000-0000-4000-8000-{number:012d}", "name": name, "folded_name": name}
                copies.append(row | {"revision": revision, "checksum": ""})
            session.execute(insert(ShapeRow), copies)
        yield running


def work_of_tasks(trace: Path) -> dict[str, float]:
    """The most work that a task of the page's main thread does.

    Elements that it styles, boxes that it lays out, boxes of the document, and milliseconds of the processor.
    """
    events = json.loads(trace.read_text())["traceEvents"]
    threads = [event for event in events if event["name"] == "thread_name"]
    mains = {(e["pid"], e["tid"]) for e in threads if e["args"]["name"] == "CrRendererMain"}
    own = [event for event in events if (event["pid"], event["tid"]) in mains]
    tasks = sorted((e for e in own if e["name"] == "ThreadControllerImpl::RunTask"), key=lambda e: e["ts"])
    assert len(tasks) > 1000
    starts = [task["ts"] for task in tasks]
    styled, laid_out, boxes = Counter[int](), Counter[int](), 0
    for event in own:
        begin = event.get("args", {}).get("beginData", {})
        task = bisect(starts, event["ts"])
        if event["name"] == "UpdateLayoutTree":
            styled[task] += event["args"].get("elementCount", 0)
        elif event["name"] == "Layout":
            laid_out[task] += begin.get("dirtyObjects", 0)
            boxes = max(boxes, begin.get("totalObjects", 0))
    return {
        "elements styled": max(styled.values()),
        "boxes laid out": max(laid_out.values()),
        "boxes": boxes,
        "milliseconds": max(task.get("tdur", 0) for task in tasks) / 1000,
    }


def test_the_work_of_scrolling_does_not_grow_with_ten_thousand_shapes(
    many: Running, browser: Browser, tmp_path: Path
) -> None:
    with visiting(browser, many) as visit:
        page = visit.page
        show(page, f"{visit.here}/?view=browse", "#gallery li")
        page.evaluate(
            """() => {
                const gallery = document.getElementById("gallery");
                window.seen = new Set();
                window.most = 0;
                const look = () => {
                    const shown = gallery.querySelectorAll(".name");
                    window.most = Math.max(window.most, shown.length);
                    for (const name of shown) window.seen.add(name.textContent);
                };
                new MutationObserver(look).observe(gallery, { subtree: true, childList: true });
                look();
            }"""
        )
        page.mouse.move(600, 600)
        trace = tmp_path / "trace.json"
        browser.start_tracing(page=page, path=trace, categories=["toplevel", "devtools.timeline"])
        for _ in range(3000):
            page.mouse.wheel(0, 3000)
            page.wait_for_timeout(30)
            if page.inner_text("#gallery-status") == f"{MANY} of {MANY} shown":
                break
        # And back, over shapes that have been shown.
        for _ in range(100):
            page.mouse.wheel(0, -3000)
            page.wait_for_timeout(30)
        browser.stop_tracing()
        expect(page.locator("#gallery-status")).to_have_text(f"{MANY} of {MANY} shown")
        work = work_of_tasks(trace)
        print(f"{MANY} shapes, the most work of a task: {work}")
        assert all(work[name] <= most for name, most in MOST.items())
        assert page.evaluate("window.seen.size") == MANY
        # Shapes far from the window are not kept in the document.
        assert page.evaluate("window.most") < 300
        page.evaluate("scrollTo(0, 0)")
        expect(page.locator("#gallery li").first).to_contain_text("fish.ply")
        page.keyboard.press("End")
        last = page.locator("#gallery li").last
        expect(last).to_contain_text(f"part-{MANY - 1:05d}.ply")
        last.scroll_into_view_if_needed()
        expect(last.locator("img")).to_have_js_property("naturalWidth", 256)
