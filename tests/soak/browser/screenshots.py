"""Screenshots of the page, as the README shows them: `make screenshots`."""

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect, sync_playwright

from core.gallery import CLASSES, make_shape
from core.io import write_mesh
from tests.service.support import serving, settings_in
from tests.soak.browser.support import FLAGS, PATIENCE, Visit, settled

POSES = 3
WIDE = {"viewport": {"width": 1280, "height": 860}}
PHONE = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "is_mobile": True,
    "has_touch": True,
}


def made(label: str, pose: int) -> bytes:
    return write_mesh(make_shape(label, pose), "ply")


def shoot(browser: Browser, here: str, query: Path, out: Path) -> None:
    """All of them."""
    page = found(browser, here, query, {**WIDE, "color_scheme": "light"})
    page.click("#next-point")
    shot(page, "#results", out / "page-match.png")
    page.uncheck("#points")
    page.select_option("#paint", "2")
    settled(page)
    shot(page, "#results", out / "page-eigenmap.png")
    dark = found(browser, here, query, {**WIDE, "color_scheme": "dark"})
    dark.locator("#gallery").scroll_into_view_if_needed()
    dark.locator("#gallery-title").evaluate("title => title.scrollIntoView()")
    dark.wait_for_load_state("networkidle")
    dark.screenshot(path=out / "page-gallery.png")
    phone = found(browser, here, query, {**PHONE, "color_scheme": "light"})
    phone.locator("#cards > li").nth(1).evaluate("card => card.scrollIntoView()")
    settled(phone)
    phone.screenshot(path=out / "page-phone.png")


def found(browser: Browser, here: str, query: Path, options: dict) -> Page:
    """The page with the answer to a query."""
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
    with tempfile.TemporaryDirectory() as folder, serving(settings_in(Path(folder))) as running:
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
