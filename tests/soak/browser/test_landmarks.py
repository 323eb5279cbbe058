"""Landmarks on the page of two shapes: placed by a click, found on the other, corrected, and exported."""

import csv
import io

import numpy as np
from playwright.sync_api import Page, expect

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.dense.solids import chair
from tests.service.support import Running
from tests.soak.browser.support import Visit, serious

APART = np.array([40.0, -30.0, 20.0])


def exported(page: Page) -> list[dict[str, str]]:
    with page.expect_download() as download:
        page.get_by_role("button", name="Export CSV").click()
    assert download.value.suggested_filename == "landmarks of one.ply and other.ply.csv"
    return list(csv.DictReader(io.StringIO(download.value.path().read_text(encoding="utf-8"))))


def points_of(row: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:
    first, second = ([float(row[name + end]) for name in "xyz"] for end in ("", "2"))
    return np.array(first), np.array(second)


def test_landmarks_are_placed_named_corrected_and_exported(visit: Visit, running: Running) -> None:
    running.clear()
    one = chair()
    other = Mesh(2.0 * one.vertices + APART, one.faces)
    ids = [
        running.store(write_mesh(mesh, "ply"), name)["id"]
        for mesh, name in ((one, "one.ply"), (other, "other.ply"))
    ]
    page = visit.page
    page.goto(f"{visit.here}/?shape_id={ids[0]}")
    page.get_by_role("link", name="Compare with other.ply").click()
    expect(page.locator("#title")).to_have_text("one.ply and other.ply")
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(2)
    expect(page.locator("#point-status")).to_contain_text("Click on the first shape to place a landmark.")
    canvases = page.locator("#cards canvas")
    export = page.get_by_role("button", name="Export CSV")
    expect(export).to_be_disabled()
    for place in (0.5, 0.45):
        box = canvases.first.bounding_box()
        assert box is not None
        canvases.first.click(position={"x": 0.5 * box["width"], "y": place * box["height"]})
        expect(export).to_be_enabled()
    names = page.get_by_label("Name of the landmark")
    expect(names).to_have_count(2)
    names.first.fill("seat")
    expect(page.locator("#landmark-list")).to_contain_text("confidence")
    assert serious(page) == []
    rows = exported(page)
    assert [row["name"] for row in rows] == ["seat", "landmark 2"]
    for row in rows:
        here, there = points_of(row)
        low, high = one.vertices.min(axis=0) - 1e-3, one.vertices.max(axis=0) + 1e-3
        assert ((low < here) & (here < high)).all()
        np.testing.assert_allclose(there, 2.0 * here + APART, atol=0.02)
        assert float(row["confidence"]) > 0.9
    # A click on the second shape corrects the landmark that was named last; here it is at the same place.
    canvases.last.click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    expect(page.locator("#landmark-list li").first).to_contain_text("set by hand")
    expect(export).to_be_enabled()
    page.wait_for_load_state("networkidle")
    here, there = points_of(exported(page)[0])
    np.testing.assert_allclose(there, 2.0 * here + APART, atol=0.1)
    page.get_by_role("button", name="Remove").last.click()
    expect(names).to_have_count(1)
    # Empty space places nothing.
    canvases.first.click(position={"x": 2, "y": 2})
    expect(names).to_have_count(1)
