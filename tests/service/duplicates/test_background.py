"""Shapes are judged in the background, but only while nothing else is at work."""

import time
from pathlib import Path

import pytest

from service.duplicates import service
from service.storage.tables import JudgedShapeRow
from tests.service.duplicates.test_judging import copy_of_plane
from tests.service.engines import on_postgresql
from tests.service.support import serving, settings_in, wait_until
from tests.service.tasks import meet


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "LOOK_SECONDS", 0.1)
    monkeypatch.setattr(service, "BUSY_SECONDS", 0.05)


def test_requests_and_tasks_come_before_the_background(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, workers=2, duplicates_in_background=True)) as running:
        container = running.container
        try:
            with container.queue.admitted():
                for seed in range(2):
                    running.store(copy_of_plane(seed), f"{seed}.off")
                wait_until(container.comparing_is_ready.is_set, seconds=60)
                time.sleep(1.0)
                assert running.rows(JudgedShapeRow) == 0
                task = container.pool.submit(meet, str(tmp_path / "task"), str(tmp_path / "end"))
                wait_until((tmp_path / "task").exists, seconds=60)
            time.sleep(1.0)
            assert running.rows(JudgedShapeRow) == 0
        finally:
            (tmp_path / "end").touch()
        task.result(60)
        wait_until(lambda: running.rows(JudgedShapeRow) == 2, seconds=60)


@on_postgresql
def test_signatures_in_the_database_are_not_read_for_the_background(tmp_path: Path, engine: str) -> None:
    settings = settings_in(tmp_path, signatures="database", duplicates_in_background=True)
    with serving(settings) as running:
        running.store(copy_of_plane(0))
        wait_until(running.container.comparing_is_ready.is_set, seconds=60)
        time.sleep(1.0)
        assert running.rows(JudgedShapeRow) == 0
