"""`isoshape reembed`, stopped and killed again and again."""

import signal
from pathlib import Path

import pytest

from tests.service.cli.conftest import environment, run
from tests.service.cli.test_reembed import Run, archive_to_reembed, assert_goes_on

__all__ = ["environment", "run"]


def test_stopped_and_killed_it_goes_on_and_does_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    few = archive_to_reembed(tmp_path, monkeypatch, 120)
    stops = ((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9))
    assert_goes_on(tmp_path, few, run, *stops)
