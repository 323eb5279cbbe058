"""Made shapes, and a page with what may go wrong on it."""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from core.gallery import make_shape
from core.io import write_mesh
from tests.service.support import Running

# Root needs the first; the others draw without a graphics card.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
CLASSES = ("fish", "glasses")
POSES = 3

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
            "#view-upload:not([hidden]), #sign-in:not([hidden])"
        )
        return self.page

    def find(self, path: Path) -> Page:
        """Query with a file, and wait for three results drawn."""
        page = self.open()
        page.set_input_files("#find-file", path)
        drawn(page, 4)
        return page


def drawn(page: Page, count: int) -> None:
    """Wait until so many shapes are drawn."""
    expect(page.locator("#cards canvas[data-drawn]")).to_have_count(count)
    settled(page)


def choose(page: Page, name: str, action: str) -> None:
    """Choose an action in the menu of a shape's card."""
    menu = page.get_by_role("button", name=f"Menu of {name}")
    # The menu closes when the page scrolls.
    menu.scroll_into_view_if_needed()
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    menu.click()
    page.locator("#card-menu").get_by_text(action, exact=True).click()


@cache
def made(label: str, pose: int) -> bytes:
    """A shape of the gallery as a file."""
    return write_mesh(make_shape(label, pose), "ply")


def settled(page: Page) -> None:
    """Wait until what was asked for is painted and drawn."""
    expect(page.locator("#cards")).to_have_attribute("data-painted", page.input_value("#paint"))
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def stocked_names() -> list[str]:
    """The names of the shapes that `stock` stores."""
    return [f"{label}-{pose}.ply" for label in CLASSES for pose in range(POSES)]


def stock(running: Running) -> None:
    """Store some shapes of each class."""
    for label in CLASSES:
        for pose in range(POSES):
            running.store(made(label, pose), f"{label}-{pose}.ply", tags=f"{label},made")


def file_in(folder: Path, label: str = "fish", pose: int = POSES) -> Path:
    """A pose that is not stored, as a file."""
    path = folder / f"{label}-{pose}.ply"
    path.write_bytes(made(label, pose))
    return path


def picture(canvas: Locator, folder: Path) -> np.ndarray:
    """The pixels of an element: float64, shape (h, w, 3)."""
    path = folder / "shown.png"
    canvas.screenshot(path=path)
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def hues(shown: np.ndarray) -> int:
    """The number of twelve colours of the wheel that are seen on at least 30 pixels."""
    low, high = shown.min(axis=2), shown.max(axis=2)
    vivid = (high - low) > 60
    red, green, blue = (shown[vivid] - low[vivid][:, None]).T / (high - low)[vivid]
    wheel = np.degrees(np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)) % 360
    return int((np.bincount((wheel // 30).astype(int), minlength=12) >= 30).sum())
