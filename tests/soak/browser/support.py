"""Made shapes, and a page of a real browser with what may go wrong on it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, Route, expect, sync_playwright

from core.gallery import make_shape
from core.io import write_mesh
from tests.service.support import Running

# Root needs the first; the others draw without a graphics card.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
CLASSES = ("fish", "glasses")
POSES = 3
NAMES = [f"{label}-{pose}.ply" for label in CLASSES for pose in range(POSES)]
"""The files of the shapes that `stock` stores."""
PHONE = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}

# In milliseconds. The machine may be busy.
PATIENCE = 300_000
expect.set_options(timeout=PATIENCE)


@dataclass
class Visit:
    """A page, what went wrong on it, and which of that a test expects."""

    page: Page
    here: str
    faults: list[str] = field(default_factory=list)
    expected: list[str] = field(default_factory=list)

    def open(self, view: str = "find", **parameters: str) -> Page:
        """A view of the page, with its first shapes."""
        self.page.goto(f"{self.here}/?{urlencode({'view': view, **parameters})}")
        self.page.wait_for_selector(
            "#start-shapes li, #gallery li, #map li, #duplicates li, "
            "#view-upload:not([hidden]), #view-library:not([hidden]), #sign-in:not([hidden])"
        )
        return self.page

    def find(self, path: Path) -> Page:
        """Query with a file, and wait for three results drawn."""
        page = self.open()
        page.set_input_files("#find-file", path)
        drawn(page, 4)
        return page


@contextmanager
def chromium() -> Iterator[Browser]:
    program = shutil.which("chromium")
    assert program, "Debian's package chromium is needed"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield browser
        browser.close()


@contextmanager
def visiting(browser: Browser, running: Running, **options: Any) -> Iterator[Visit]:
    """A page of a fresh browser that is let at nothing but a service; at the end nothing may be wrong."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
    context.set_default_timeout(PATIENCE)
    visit = Visit(context.new_page(), str(running.client.base_url).rstrip("/"))

    def pass_or_stop(route: Route) -> None:
        if urlsplit(route.request.url).netloc == urlsplit(visit.here).netloc:
            route.continue_()
        else:
            visit.faults.append(f"elsewhere: {route.request.url}")
            route.abort()

    def note(message: ConsoleMessage) -> None:
        if message.type in {"error", "warning"}:
            visit.faults.append(f"{message.type}: {message.text}")

    context.route(lambda url: not url.startswith(("data:", "blob:")), pass_or_stop)
    visit.page.on("pageerror", lambda error: visit.faults.append(f"error: {error}"))
    visit.page.on("console", note)
    yield visit
    context.close()
    wrong = [fault for fault in visit.faults if not any(part in fault for part in visit.expected)]
    assert not wrong, wrong


def held_back(page: Page, where: str) -> list[Route]:
    """The requests to an address, none of which goes on by itself."""
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route(where, hold)
    return held


def drawn(page: Page, count: int) -> None:
    """Wait until so many shapes are drawn."""
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(count)
    settled(page)


def settled(page: Page) -> None:
    """Wait until what was asked for is painted and drawn."""
    expect(page.locator("#cards")).to_have_attribute("data-painted", page.input_value("#paint"))
    next_frame(page)


def next_frame(page: Page) -> None:
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def paint(page: Page, choice: str) -> None:
    """Choose how shapes are coloured, and wait for it."""
    page.select_option("#paint", choice)
    settled(page)


def show(page: Page, address: str, pictures: str) -> None:
    """Open an address and wait until its pictures are loaded."""
    page.goto(address)
    page.wait_for_selector(pictures)
    page.wait_for_load_state("networkidle")


def choose(page: Page, name: str, action: str) -> None:
    """Choose an action in the menu of a shape's card."""
    menu = page.get_by_role("button", name=f"Menu of {name}")
    # The menu closes when the page scrolls.
    menu.scroll_into_view_if_needed()
    next_frame(page)
    menu.click()
    page.locator("#card-menu").get_by_text(action, exact=True).click()


def box_of(element: Locator) -> dict[str, float]:
    box = element.bounding_box()
    assert box is not None
    return dict(box)


def serious(page: Page) -> list[str]:
    """The barriers to people that axe-core finds, and whether the page is wider than the screen."""
    barriers = [
        f"{each['id']}: {[node['target'] for node in each['nodes']]}"
        for each in Axe().run(page).response["violations"]
        if each["impact"] in {"serious", "critical"}
    ]
    wide = page.evaluate("document.documentElement.scrollWidth > innerWidth")
    return [*barriers, "wider than the screen"] if wide else barriers


@cache
def made(label: str, pose: int) -> bytes:
    """A shape of the gallery as a file."""
    return write_mesh(make_shape(label, pose), "ply")


def stock(running: Running) -> None:
    """Store some shapes of each class."""
    for name in NAMES:
        label, pose = name.removesuffix(".ply").split("-")
        running.store(made(label, int(pose)), name, tags=f"{label},made")


def stored(running: Running, **parameters: str) -> list[dict[str, Any]]:
    """The stored shapes that a filter passes."""
    return list(running.client.get("/shapes", params=parameters).json()["shapes"])


def file_in(folder: Path, data: bytes | None = None, name: str = f"fish-{POSES}.ply") -> Path:
    """A file; of a pose that is not stored, unless its bytes are given."""
    path = folder / name
    path.write_bytes(made("fish", POSES) if data is None else data)
    return path


def picture(element: Locator) -> np.ndarray:
    """The pixels of an element: float64, shape (h, w, 3)."""
    return np.asarray(Image.open(BytesIO(element.screenshot())).convert("RGB")).astype(float)


def pictures(page: Page) -> list[np.ndarray]:
    """The pixels of each shape, without the mark of what has the focus."""
    page.evaluate("document.activeElement.blur()")
    return [picture(canvas) for canvas in page.locator("#cards canvas").all()]


def hues(shown: np.ndarray) -> int:
    """The number of twelve colours of the wheel that are seen on at least 30 pixels."""
    low, high = shown.min(axis=2), shown.max(axis=2)
    vivid = (high - low) > 60
    red, green, blue = (shown[vivid] - low[vivid][:, None]).T / (high - low)[vivid]
    wheel = np.degrees(np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)) % 360
    return int((np.bincount((wheel // 30).astype(int), minlength=12) >= 30).sum())
