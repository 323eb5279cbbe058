"""One service for all tests that can share it, on each engine: starting workers takes seconds."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from service.observability import logging
from service.search import compare
from tests.service import engines
from tests.service.support import Running, serving, settings_in


@pytest.fixture(scope="session", autouse=True)
def _stopped_at_the_end() -> Iterator[None]:
    # The log of all services is that of the whole run, not of the test that starts the first one.
    logging.configure("warning")
    yield
    engines.stop()


@pytest.fixture(scope="module", autouse=True)
def engine(request: pytest.FixtureRequest) -> Iterator[str]:
    """The engine that keeps the archives: the parameter of the tests, or SQLite."""
    name = str(getattr(request, "param", engines.SQLITE))
    with engines.using(name):
        yield name


@pytest.fixture(scope="session")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Running]]:
    """The service on an engine, started when it is first asked for."""
    running: dict[str, Running] = {}
    with ExitStack() as stack:

        def on(name: str) -> Running:
            if name not in running:
                with engines.using(name):
                    roots = (str(tmp_path_factory.getbasetemp()),)
                    folder = tmp_path_factory.mktemp("service")
                    settings = settings_in(folder, workers=2, source_roots=roots)
                running[name] = stack.enter_context(serving(settings))
            return running[name]

        yield on


@pytest.fixture(scope="module")
def shared(services: Callable[[str], Running], engine: str) -> Running:
    """A service with default limits, holding whatever earlier tests left."""
    return services(engine)


@pytest.fixture
def service(shared: Running) -> Running:
    """The shared service, holding nothing."""
    shared.clear()
    return shared


@pytest.fixture(scope="module")
def few_functions() -> Iterator[None]:
    """Dense correspondences by 100 functions, in a third of the time: the core has tests of more."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compare, "FINE", compare.FUNCTIONS)
        yield
