"""A folder that is a source, and scans of it that have ended."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.service.support import Running, wait_until

LONG_AGO = 1_700_000_000


def put(path: Path, data: bytes) -> Path:
    """Write a file as one that was last written long ago."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    # Each second of one file is another time of change.
    seconds = LONG_AGO + len(data) + data[len(data) // 2]
    os.utime(path, (seconds, seconds))
    return path


@dataclass(frozen=True)
class Library:
    """A source of a running service."""

    running: Running
    id: str
    root: Path

    @classmethod
    @contextmanager
    def of(cls, running: Running, root: Path, **fields: Any) -> Iterator["Library"]:
        """Add a folder, wait for its first scan, and remove it at the end."""
        answer = running.client.post("/sources", json={"path": str(root), "name": f"{root}", **fields})
        assert answer.status_code == 201, answer.text
        library = cls(running, answer.json()["id"], Path(answer.json()["path"]))
        library.wait()
        yield library
        assert running.client.delete(f"/sources/{library.id}").status_code == 204

    def wait(self) -> dict[str, Any]:
        """Wait until no scan runs; the source."""
        wait_until(lambda: self.read()["state"] in {"ready", "offline"}, seconds=60)
        return self.read()

    def read(self) -> dict[str, Any]:
        """The source."""
        answer = self.running.client.get(f"/sources/{self.id}")
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def rescan(self, action: str = "rescan") -> dict[str, Any]:
        """Scan the folder; the source after it."""
        answer = self.running.client.post(f"/sources/{self.id}/{action}")
        assert answer.status_code == 202, answer.text
        return self.wait()

    def files(self, **conditions: Any) -> dict[str, dict[str, Any]]:
        """The files of the source by their paths."""
        params = {"limit": 500, **conditions}
        page = self.running.client.get(f"/sources/{self.id}/files", params=params).json()
        return {file["path"]: file for file in page["files"]}

    def shapes(self) -> Mapping[str, str]:
        """The id of each file's shape, by the path of the file."""
        return {path: file["shape_id"] for path, file in self.files().items()}
