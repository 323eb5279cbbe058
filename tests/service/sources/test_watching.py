"""The watch on folders: a new file is reported, and without folders there is nothing."""

import asyncio
from pathlib import Path

import pytest

from service.sources import watching
from service.sources.watching import Watch


def test_a_new_file_is_reported_and_the_watch_stops_at_once(root: Path) -> None:
    async def follow() -> list[int]:
        reported: list[int] = []
        watch = Watch(reported.append)
        await watch.follow({})
        assert watch._watching is None
        (root.parent / "other").mkdir()
        await watch.follow({7: str(root), 8: str(root.parent / "other"), 9: str(root / "absent")})
        assert [number for number in (7, 8, 9) if watch.follows(number)] == [7, 8]
        async with asyncio.timeout(10):
            for number in range(500):
                # The watch begins in a thread.
                (root / f"{number}.off").touch()
                await asyncio.sleep(0.02)
                if reported:
                    break
        async with asyncio.timeout(2):
            await watch.stop()
        return reported

    assert set(asyncio.run(follow())) == {7}


def test_a_network_mount_is_not_watched(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mounts = tmp_path / "mountinfo"
    mounts.write_text(f"1 0 0:1 / {root} rw - fuse.sshfs nas: rw\n")
    monkeypatch.setattr(watching, "MOUNTS", mounts)
    assert watching.reporting({1: str(root), 2: str(root.parent)}) == {2: str(root.parent)}
