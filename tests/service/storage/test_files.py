"""Files and folders that outlast a loss of power, and disks that fail."""

import errno
import os
from pathlib import Path

import pytest

from service.errors import StorageFullError, StorageUnavailableError
from service.storage.files import disk_errors, make_folder, put_in_place
from service.storage.sqlite import ServingLock


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The paths that are synced, in their order."""
    paths: list[str] = []
    monkeypatch.setattr(
        os, "fsync", lambda descriptor: paths.append(os.readlink(f"/proc/self/fd/{descriptor}"))
    )
    return paths


def fail(code: int) -> None:
    raise OSError(code, os.strerror(code))


def test_each_folder_that_is_made_is_synced_in_the_one_above_it(tmp_path: Path, synced: list[str]) -> None:
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    assert synced == [str(tmp_path), str(tmp_path / "a")]
    make_folder(tmp_path / "a" / "b")
    assert len(synced) == 2


def test_a_file_is_synced_before_it_has_its_name_and_the_name_after_it(
    tmp_path: Path, synced: list[str]
) -> None:
    (tmp_path / "part").write_bytes(b"whole")
    put_in_place(tmp_path / "part", tmp_path / "target")
    assert synced == [str(tmp_path / "part"), str(tmp_path)]
    assert [path.name for path in tmp_path.iterdir()] == ["target"]


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (errno.ENOSPC, StorageFullError),
        (errno.EDQUOT, StorageFullError),
        (errno.EIO, StorageUnavailableError),
        (errno.EROFS, StorageUnavailableError),
    ],
)
def test_errors_of_a_disk_are_errors_of_the_service(code: int, kind: type[Exception]) -> None:
    with pytest.raises(kind, match=f"no archive: {os.strerror(code)}"), disk_errors("no archive"):
        fail(code)


def test_a_service_whose_lock_cannot_be_written_does_not_keep_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", lambda *_: fail(errno.ENOSPC))
        with pytest.raises(StorageFullError):
            ServingLock(tmp_path / "archive.sqlite3", "address")
    ServingLock(tmp_path / "archive.sqlite3", "address").release()
