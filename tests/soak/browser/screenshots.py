"""Screenshots of the page, as the README shows them: `make screenshots`."""

import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page

from core.gallery import CLASSES
from tests.service.support import Running, serving, settings_in
from tests.soak.browser.support import (
    PHONE,
    POSES,
    chromium,
    file_in,
    made,
    paint,
    settled,
    show,
    stored,
    visiting,
)

WIDE = {"viewport": {"width": 1280, "height": 800}, "color_scheme": "light"}
NARROW = {**PHONE, "viewport": {"width": 390, "height": 844}, "color_scheme": "dark"}


def shoot(browser: Browser, running: Running, query: Path, out: Path) -> None:
    """Draw the pictures that docs/page.md shows."""
    with visiting(browser, running, **WIDE) as visit:
        page = visit.find(query)
        page.click("#next-point")
        page.screenshot(path=out / "page-match.png")
        page.uncheck("#points")
        paint(page, "2")
        shot(page, out / "page-eigenmap.png")
        shape = stored(running, name="hand-0")[0]
        show(page, f"{visit.here}/shapes/{shape['id']}/view", "#cards canvas[data-drawn]")
        small(page, out / "page-shape.png")
        for view, pictures in (("browse", "#gallery img"), ("map", "#map[data-missing='0']")):
            show(page, f"{visit.here}/?view={view}", pictures)
            for box in page.get_by_role("checkbox").all()[1:3]:
                box.check()
            small(page, out / f"page-{view}.png")
    with visiting(browser, running, **NARROW) as visit:
        visit.find(query)
        show(visit.page, f"{visit.here}/?view=browse", "#gallery img")
        small(visit.page, out / "page-browse-narrow.png")


def small(page: Page, path: Path) -> None:
    """Save a screenshot of 256 colours."""
    shown = Image.open(BytesIO(page.screenshot())).convert("RGB")
    shown.quantize(256).save(path, optimize=True)


def shot(page: Page, path: Path) -> None:
    page.evaluate("document.activeElement.blur()")
    settled(page)
    page.locator("#results").screenshot(path=path)


def main(out: Path) -> None:
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(settings_in(Path(folder), undo_days=7)) as running,
        chromium() as browser,
    ):
        for label in CLASSES:
            for pose in range(POSES):
                running.store(made(label, pose), f"{label}-{pose}.ply", tags=label)
        shoot(browser, running, file_in(Path(folder), made("quadruped", POSES), "dog.ply"), out)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
