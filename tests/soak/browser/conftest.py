"""A real service with made shapes, and a real browser that is let at nothing else."""

import shutil
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, Route, sync_playwright

from tests.service.support import Running, serving, settings_in
from tests.soak.browser.support import FLAGS, PATIENCE, Visit, stock, stocked_names


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with serving(settings_in(tmp_path_factory.mktemp("browser"), workers=1, undo_days=7)) as running:
        yield running


@pytest.fixture
def service(running: Running) -> Running:
    """The service, holding six shapes of two classes."""
    shapes = running.client.get("/shapes").json()["shapes"]
    if sorted(shape["name"] for shape in shapes) != sorted(stocked_names()):
        running.clear()
        stock(running)
    return running


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    chromium = shutil.which("chromium")
    assert chromium, "the tests need Debian's package chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser: Browser, service: Running, request: pytest.FixtureRequest) -> Iterator[Visit]:
    """A page of a fresh browser. At the end nothing may have gone wrong, or elsewhere."""
    options = getattr(request, "param", {})
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
    here = str(service.client.base_url)
    context.set_default_timeout(PATIENCE)
    visit = Visit(context.new_page(), here)
    elsewhere: list[str] = []

    def pass_or_stop(route: Route) -> None:
        if urlsplit(route.request.url).netloc == urlsplit(here).netloc:
            route.continue_()
        else:
            elsewhere.append(route.request.url)
            route.abort()

    context.route(lambda url: not url.startswith(("data:", "blob:")), pass_or_stop)
    watch(visit.page, visit.faults)
    yield visit
    context.close()
    assert elsewhere == []
    unexpected = [fault for fault in visit.faults if not any(part in fault for part in visit.expected)]
    assert unexpected == []


def watch(page: Page, faults: list[str]) -> None:
    """Note what a browser's console would show as wrong."""
    page.on("pageerror", lambda error: faults.append(f"error: {error}"))
    page.on(
        "console",
        lambda message: (
            faults.append(f"{message.type}: {message.text}") if message.type in {"error", "warning"} else None
        ),
    )
