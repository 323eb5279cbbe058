"""What a loss of power leaves of a folder, by the log of the operations that changed it (`faults.c`).

The bytes of a file last when the file is synced, and its name when its folder is: nothing else is certain.
"""

import random
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

SECTOR = 512
"""Bytes that a disk writes whole or not at all."""

NOT_COMPARED = "-shm"
"""The ending of the index of a write-ahead log, which is memory shared by processes and is made anew."""


class Operation(NamedTuple):
    """One operation that was done; `size` is the new size of a file, or that of the data of a write."""

    kind: str
    inode: int
    offset: int
    size: int
    path: str
    other: str
    data: bytes


def operations(log: bytes) -> Iterator[Operation]:
    """Read a log."""
    while log:
        line, _, log = log.partition(b"\n")
        kind, inode, offset, size, path, other = line.decode().split("\t")
        length = int(size) if kind == "write" else 0
        yield Operation(kind, int(inode), int(offset), int(size), path, other, log[:length])
        log = log[length:]


@dataclass(eq=False)
class File:
    """The synced bytes of a file, and its changes since then, in their order."""

    synced: bytes = b""
    changes: list[Operation] = field(default_factory=list)

    def bytes(self, draw: random.Random | None = None) -> bytes:
        """Return the bytes after all changes or, with `draw`, after some, and first sectors of others."""
        content = bytearray(self.synced)
        for change in self.changes:
            if draw is not None and draw.random() < 0.4:
                continue
            torn = draw is not None and draw.random() < 0.3
            data = change.data[: len(change.data) // 2 // SECTOR * SECTOR] if torn else change.data
            size = change.offset + len(data) if change.kind == "write" else change.size
            content.extend(bytes(max(0, size - len(content))))
            if change.kind == "write":
                content[change.offset : size] = data
            elif change.kind == "truncate":
                del content[size:]
        return bytes(content)


Content = dict[str, bytes | None]
"""The bytes of each file by its path; None is a folder."""

Names = dict[str, File | None]


class Disk:
    """A folder, all of which has been synced at first, and what has happened to it since."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.syncs = 0
        self._inodes: dict[int, File] = {}
        self._names: Names = {}
        for path in sorted(folder.rglob("*")):
            self._names[str(path)] = None if path.is_dir() else File(path.read_bytes())
            if path.is_file():
                self._inodes[path.stat().st_ino] = self._names[str(path)] or File()
        self._synced_names = dict(self._names)

    def do(self, operation: Operation) -> None:
        """Follow an operation."""
        self.syncs += operation.kind.startswith("sync")
        match operation.kind:
            case "create":
                # The number may be that of a file that was removed.
                file = self._inodes[operation.inode] = File()
                if operation.path:
                    self._names[operation.path] = file
            case "make folder":
                self._names[operation.path] = None
            case "remove":
                del self._names[operation.path]
            case "rename":
                self._names[operation.other] = self._names.pop(operation.path)
            case "write" | "truncate" | "allocate":
                self._inodes[operation.inode].changes.append(operation)
            case "sync":
                file = self._inodes[operation.inode]
                file.synced, file.changes = file.bytes(), []
            case "sync folder":
                others = {
                    name: file
                    for name, file in self._synced_names.items()
                    if folder_of(name) != operation.path
                }
                present = {
                    name: file for name, file in self._names.items() if folder_of(name) == operation.path
                }
                self._synced_names = others | present

    def content(self) -> Content:
        """Return what is there while there is power."""
        return {name: None if file is None else file.bytes() for name, file in self._names.items()}

    def synced(self) -> Content:
        """Return what is certain to be there after a loss of power."""
        names: Names = {}
        for name in sorted(self._synced_names):
            folder = folder_of(name)
            if folder == str(self._folder) or names.get(folder, File()) is None:
                names[name] = self._synced_names[name]
        return {name: None if file is None else file.synced for name, file in names.items()}

    def partly_synced(self, seed: int) -> Content:
        """Return what may be there: all names, and of each file some of what has changed since its sync."""
        draw = random.Random(seed)
        return {name: None if file is None else file.bytes(draw) for name, file in self._names.items()}


def folder_of(name: str) -> str:
    """Return the folder of a path."""
    return name.rpartition("/")[0]


def found(folder: Path) -> Content:
    """Return what is in a folder."""
    paths = [path for path in folder.rglob("*") if not path.name.endswith(NOT_COMPARED)]
    return {str(path): None if path.is_dir() else path.read_bytes() for path in paths}


def put(content: Content, folder: Path) -> None:
    """Replace what is in a folder."""
    shutil.rmtree(folder)
    folder.mkdir()
    for name, data in sorted(content.items()):
        if data is None:
            Path(name).mkdir()
        else:
            Path(name).write_bytes(data)
