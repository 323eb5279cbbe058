"""The mesh files and zip files under a folder: paths and sizes, without reading a file.

Hidden files and folders, and those that `.isoshapeignore` of the root names in the syntax of .gitignore, are
left out. A link to a file of the folder is a second path of that file; a link to a folder, or out of the
folder, is left out, so that no loop of links is entered.
"""

import os
import stat
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from core.io import FORMATS
from service.sources.rules import spec_of
from service.storage.in_place import open_beneath, open_folder

IGNORE = ".isoshapeignore"
IGNORE_BYTES = 64 * 1024
ARCHIVE = "zip"
DEPTH = 64
"""Folders within folders; deeper ones are reported."""

PATH_BYTES = 2_000
"""The longest path, in bytes of UTF-8: an index of PostgreSQL holds no longer key."""


class RootMissingError(Exception):
    """The root is no folder that can be listed, or its patterns are wrong; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class FoundFile:
    """A mesh file: its `path` from the root as the disk spells it, and what tells whether it has changed.

    `device` and `inode` are signed 64-bit numbers, as databases have them. `archive` is the zip that has the
    file, if one has.
    """

    path: str
    size: int
    mtime_ns: int
    device: int
    inode: int
    archive: "FoundFile | None" = None

    @property
    def same_bytes(self) -> tuple[int, int, int]:
        """The values that two paths of one unchanged file share, also after a restart of the system."""
        return self.inode, self.size, self.mtime_ns


@dataclass
class Tree:
    """The mesh files of a folder, by their paths in the normal form NFC, and its zip files.

    `unread` has the paths of folders and files that could not be listed, each with the reason: nothing is
    known about the files there. `is_ignored` tells of a path whether `.isoshapeignore` leaves it out.
    """

    files: dict[str, FoundFile] = field(default_factory=dict)
    archives: list[FoundFile] = field(default_factory=list)
    unread: dict[str, str] = field(default_factory=dict)
    is_ignored: Callable[[str], bool] = lambda _: False

    def may_have(self, key: str) -> bool:
        """Return whether a file that was not found may be in a folder that could not be listed."""
        parts = key.split("/")
        return bool(self.unread) and any(
            "/".join(parts[:length]) in self.unread for length in range(len(parts) + 1)
        )


def find_files(root: Path, stopped: Callable[[], bool] = lambda: False) -> Tree:
    """Return the mesh files and the zip files of a folder, by the endings of their names.

    When `stopped` returns true, nobody waits for the answer any more.

    Raises
    ------
    RootMissingError
        The folder cannot be listed.
    """
    tree = Tree()
    try:
        tree.is_ignored = _ignored(root)
        folder = open_folder(str(root))
    except OSError as error:
        raise RootMissingError(f"{root}: {error.strerror or error}") from error
    try:
        entries = _Walk(root, stopped, tree).entries(folder, "", 0)
        # A name in NFC comes before other forms of it, so that it always has its own key.
        for found in sorted(entries, key=lambda file: not unicodedata.is_normalized("NFC", file.path)):
            if _ending(found.path) == ARCHIVE:
                tree.archives.append(found)
                continue
            key = normal(found.path)
            tree.files[found.path if key in tree.files else key] = found
    finally:
        os.close(folder)
    if "" in tree.unread:
        raise RootMissingError(f"{root}: {tree.unread['']}")
    return tree


@cache
def endings() -> frozenset[str]:
    """Return the endings of mesh files, in lower case and without dots."""
    return frozenset(ending for format in FORMATS.values() if format.is_read for ending in format.endings)


def is_read(path: str) -> bool:
    """Return whether a file is a mesh, or a zip that may have some, by its ending."""
    ending = _ending(path)
    return ending == ARCHIVE or ending in endings()


def _ending(path: str) -> str:
    return path.rpartition(".")[2].lower()


def normal(path: str) -> str:
    """Return a path in the normal form NFC: one disk spells it so, another in NFD."""
    return path if path.isascii() else unicodedata.normalize("NFC", path)


def signed(number: int) -> int:
    """Return an unsigned 64-bit number as a signed one."""
    return number - 2**64 if number >= 2**63 else number


def _ignored(root: Path) -> Callable[[str], bool]:
    """Read the patterns of the root, or raise RootMissingError; without any, nothing is left out."""
    try:
        with open(open_beneath(root, IGNORE), "rb") as file:
            lines = file.read(IGNORE_BYTES).decode(errors="replace").splitlines()
    except FileNotFoundError:
        root.stat()
        return lambda _: False
    try:
        return spec_of([line for line in lines if line.strip()]).match_file
    except ValueError as error:
        raise RootMissingError(f"{root / IGNORE}: {error}") from error


class _Walk:
    """The walk through one folder."""

    def __init__(self, root: Path, stopped: Callable[[], bool], tree: Tree) -> None:
        self._root, self._stopped, self._tree = root, stopped, tree

    def entries(self, folder: int, path: str, depth: int) -> Iterator[FoundFile]:
        """Yield the files of an open folder and of the folders in it."""
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if self._stopped():
                        raise RootMissingError("the scan was stopped")
                    if not entry.name.startswith("."):
                        inner = f"{path}/{entry.name}" if path else entry.name
                        yield from self._entry(folder, entry, inner, depth)
        except OSError as error:
            self._report(path, error.strerror or str(error))

    def _entry(self, folder: int, entry: "os.DirEntry[str]", path: str, depth: int) -> Iterator[FoundFile]:
        try:
            if entry.is_dir(follow_symlinks=False):
                if not self._tree.is_ignored(f"{path}/"):
                    yield from self._folder(folder, entry.name, path, depth + 1)
            elif is_read(entry.name) and not self._tree.is_ignored(path):
                yield from self._file(entry, path)
        except OSError as error:
            self._report(path, error.strerror or str(error))

    def _folder(self, within: int, name: str, path: str, depth: int) -> Iterator[FoundFile]:
        if depth > DEPTH:
            self._report(path, f"deeper than {DEPTH} folders")
            return
        folder = open_folder(name, within)
        try:
            yield from self.entries(folder, path, depth)
        finally:
            os.close(folder)

    def _file(self, entry: "os.DirEntry[str]", path: str) -> Iterator[FoundFile]:
        try:
            length = len(path.encode())
        except UnicodeEncodeError:
            self._report(path.encode(errors="replace").decode(), "the name is not UTF-8")
            return
        if length > PATH_BYTES:
            self._report(path, f"the path is longer than {PATH_BYTES} bytes")
            return
        about = entry.stat(follow_symlinks=False)
        if stat.S_ISLNK(about.st_mode):
            real = Path(os.path.realpath(self._root / path))
            if not real.is_relative_to(self._root) or not real.is_file():
                return
            about = real.stat()
        if stat.S_ISREG(about.st_mode):
            yield FoundFile(
                path, about.st_size, about.st_mtime_ns, signed(about.st_dev), signed(about.st_ino)
            )

    def _report(self, path: str, reason: str) -> None:
        self._tree.unread[normal(path)] = reason
