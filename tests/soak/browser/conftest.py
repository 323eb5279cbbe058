"""A real service with made shapes, and a real browser."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.service.support import Running, serving, settings_in
from tests.soak.browser.support import NAMES, Visit, chromium, stock, stored, visiting


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    roots = (str(tmp_path_factory.getbasetemp()),)
    folder = tmp_path_factory.mktemp("browser")
    with serving(settings_in(folder, workers=1, undo_days=7, source_roots=roots)) as running:
        yield running


@pytest.fixture
def service(running: Running) -> Running:
    """The service, holding six shapes of two classes."""
    if sorted(shape["name"] for shape in stored(running)) != sorted(NAMES):
        running.clear()
        stock(running)
    return running


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def visit(browser: Browser, service: Running, request: pytest.FixtureRequest) -> Iterator[Visit]:
    with visiting(browser, service, **getattr(request, "param", {})) as visit:
        yield visit
