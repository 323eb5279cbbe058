"""A database file that is deleted, replaced or not writable, and deletions on a full disk."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from service.storage.sqlite import RESERVE_BYTES, DatabaseFile
from tests.service.support import Running, assert_problem, serving, settings_in, small_file, upload


@pytest.fixture(scope="module")
def frail(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Running, Path]]:
    """A service with a shape, and the file of its database."""
    folder = tmp_path_factory.mktemp("file")
    path = folder / "archive.sqlite3"
    with serving(settings_in(folder, database_url=f"sqlite:///{path}")) as running:
        running.store(small_file(0), name="kept")
        yield running, path


def again(running: Running) -> httpx.Response:
    """The same bytes under another name: no worker is needed."""
    return upload(running.client, small_file(0), "again.off", name="again")


def test_a_service_whose_file_is_gone_or_another_is_not_ready(frail: tuple[Running, Path]) -> None:
    running, path = frail
    away = path.with_name("away")
    path.rename(away)
    assert "gone" in assert_problem(running.client.get("/readyz"), 503, "not-ready")["detail"]
    assert_problem(again(running), 503, "storage-unavailable")
    shutil.copyfile(away, path)
    assert "another file" in assert_problem(running.client.get("/readyz"), 503, "not-ready")["detail"]
    assert_problem(again(running), 503, "storage-unavailable")
    away.rename(path)
    assert running.client.get("/readyz").status_code == 200
    assert running.client.get("/shapes").json()["total"] == 1


def test_a_file_that_cannot_be_written_is_not_touched(
    frail: tuple[Running, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A write to an immutable file would leave a journal that stops every read."""
    running, path = frail
    access = os.access
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda name, mode: name != path and access(name, mode))
        assert "SQLITE_READONLY" in assert_problem(again(running), 503, "storage-unavailable")["detail"]
        assert running.client.get("/shapes").json()["total"] == 1
        assert running.client.get("/readyz").status_code == 200
    assert path.with_name("archive.sqlite3-journal").stat().st_size == 0
    assert again(running).status_code == 201


class Disk:
    """A disk with some room besides the reserve."""

    def __init__(self, reserve: Path, free: int) -> None:
        self.reserve = reserve
        self.free = free

    def usage(self, _path: Path) -> object:
        held = self.reserve.stat().st_size if self.reserve.exists() else 0
        return type(shutil.disk_usage("/"))(0, 0, self.free - held)


def test_a_deletion_has_the_room_of_the_reserve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "archive.sqlite3"
    path.touch()
    reserve = tmp_path / "archive.sqlite3-reserve"
    disk = Disk(reserve, 3 * RESERVE_BYTES)
    real = shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda each: (disk.usage if each == tmp_path else real)(each))
    file = DatabaseFile(path)
    file.keep_reserve()
    assert reserve.stat().st_size == RESERVE_BYTES
    assert reserve.stat().st_blocks * 512 >= RESERVE_BYTES
    with file.room_to_delete():
        assert reserve.stat().st_size == RESERVE_BYTES
    # One deletion after another: a deletion frees pages of the file, and nothing of the disk.
    disk.free = RESERVE_BYTES
    for _ in range(3):
        with file.room_to_delete():
            assert reserve.stat().st_size == 0
        assert reserve.stat().st_size == RESERVE_BYTES
    # A deletion that fills the reserve leaves none, until there is room for more than the reserve.
    with file.room_to_delete():
        disk.free = RESERVE_BYTES // 2
    assert reserve.stat().st_size == 0
    disk.free = 3 * RESERVE_BYTES
    file.keep_reserve()
    assert reserve.stat().st_size == RESERVE_BYTES
