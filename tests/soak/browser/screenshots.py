"""Screenshots of the page, as the README shows them: `make screenshots`."""

import shutil
import sys
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from core.gallery import CLASSES, make_shape
from core.io import write_mesh
from tests.service.support import serving, settings_in
from tests.soak.browser.support import FLAGS, PATIENCE, Visit, settled

POSES = 3
WIDE: dict[str, Any] = {"viewport": {"width": 1280, "height": 860}, "color_scheme": "light"}
NARROW: dict[str, Any] = {
    "viewport": {"width": 390, "height": 844},
    "is_mobile": True,
    "has_touch": True,
    "color_scheme": "dark",
}


def made(label: str, pose: int) -> bytes:
    return write_mesh(make_shape(label, pose), "ply")


def shoot(browser: Browser, url: str, query: Path, out: Path) -> None:
    """Draw the pictures that docs/page.md shows."""
    page = found(browser, url, query, WIDE)
    page.click("#next-point")
    shot(page, "#results", out / "page-match.png")
    page.uncheck("#points")
    page.select_option("#paint", "2")
    settled(page)
    shot(page, "#results", out / "page-eigenmap.png")
    for view, pictures in (("browse", "#gallery img"), ("map", "#map img")):
        show(page, f"{url}/?view={view}", pictures)
        small(page, out / f"page-{view}.png")
    page.context.close()
    page = found(browser, url, query, NARROW)
    show(page, f"{url}/?view=browse", "#gallery img")
    small(page, out / "page-browse-narrow.png")
    page.context.close()


def show(page: Page, address: str, pictures: str) -> None:
    """Open a view of the page and wait until its pictures are loaded."""
    page.goto(address)
    page.wait_for_selector(pictures)
    page.wait_for_load_state("networkidle")


def small(page: Page, path: Path) -> None:
    """Save a screenshot of 256 colours."""
    shown = Image.open(BytesIO(page.screenshot())).convert("RGB")
    shown.quantize(256).save(path, optimize=True)


def found(browser: Browser, here: str, query: Path, options: dict) -> Page:
    """Return the page with the answer to a query."""
    context = browser.new_context(**options)
    context.set_default_timeout(PATIENCE)
    page = Visit(context.new_page(), here).open()
    page.set_input_files("#find-file", query)
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(4)
    settled(page)
    return page


def shot(page: Page, selector: str, path: Path) -> None:
    page.evaluate("document.activeElement.blur()")
    settled(page)
    page.locator(selector).screenshot(path=path)


def main(out: Path) -> None:
    chromium = shutil.which("chromium")
    assert chromium, "Debian's package chromium is needed"
    with tempfile.TemporaryDirectory() as folder, serving(settings_in(Path(folder), undo_days=7)) as running:
        for label in CLASSES:
            for pose in range(POSES):
                running.store(made(label, pose), f"{label}-{pose}.ply", tags=label)
        query = Path(folder) / "dog.ply"
        query.write_bytes(made("quadruped", POSES))
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
            shoot(browser, str(running.client.base_url), query, out)
            browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
