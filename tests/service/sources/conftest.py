"""A folder for a source, and a service that lets deletions be undone."""

from datetime import timedelta
from pathlib import Path

import pytest

from service.settings import Settings
from tests.service.support import Running


@pytest.fixture
def undo(monkeypatch: pytest.MonkeyPatch) -> list[timedelta]:
    """For how long deletions can be undone: the last of the list."""
    times = [timedelta(days=7)]
    monkeypatch.setattr(Settings, "undo_time", property(lambda _: times[-1]))
    return times


@pytest.fixture
def running(service: Running, undo: list[timedelta]) -> Running:
    """The shared service, whose deleted shapes can be restored, without any."""
    assert undo
    for shape in service.client.get("/deleted", params={"limit": 500}).json()["shapes"]:
        assert service.client.delete(f"/deleted/{shape['id']}").status_code == 204
    return service


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder for a source."""
    folder = tmp_path / "models"
    folder.mkdir()
    return folder
