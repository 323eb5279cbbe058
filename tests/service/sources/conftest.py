"""A folder for a source, and a service that lets deletions be undone."""

from datetime import timedelta
from pathlib import Path

import pytest

from service.settings import Settings
from tests.service.support import Running


@pytest.fixture
def running(service: Running, monkeypatch: pytest.MonkeyPatch) -> Running:
    """The shared service, whose deleted shapes can be restored."""
    monkeypatch.setattr(Settings, "undo_time", property(lambda _: timedelta(days=7)))
    return service


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder for a source."""
    folder = tmp_path / "models"
    folder.mkdir()
    return folder
