"""One service for all tests that can share it: starting workers takes seconds."""

from collections.abc import Iterator

import pytest

from tests.service.support import Running, serving, settings_in


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with default limits, holding whatever earlier tests left."""
    with serving(settings_in(tmp_path_factory.mktemp("service"))) as running:
        yield running


@pytest.fixture
def service(shared: Running) -> Running:
    """The shared service, holding nothing."""
    shared.clear()
    return shared
