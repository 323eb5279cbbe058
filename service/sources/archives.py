"""The meshes in zip files of a source: their paths, without unpacking any, and their bytes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import blake2b
from pathlib import Path
from threading import Lock
from typing import Any

from cachetools import LRUCache, cachedmethod

from service.errors import ServiceError
from service.jobs.zip_archive import (
    ArchiveMember,
    ArchiveTooLargeError,
    MemberFault,
    ReadDirectory,
    ZipArchive,
)
from service.settings import Settings
from service.sources.reading import FileInMotionError, FileUnreadableError, opened
from service.sources.walk import PATH_BYTES, FoundFile, RootMissingError, Tree, endings, normal

MEMBERS = 20_000
"""Archives, and meshes in them, whose paths are kept in memory."""


@dataclass(frozen=True)
class Directory:
    """An archive, and the meshes in it, each with its position and the reason of its refusal."""

    archive: ZipArchive
    meshes: dict[FoundFile, tuple[int, MemberFault | None]]


class Directories:
    """The directories of archives that scans have read, so that an unchanged archive is not read again."""

    def __init__(self) -> None:
        self.read: LRUCache[Any, Directory] = LRUCache(MEMBERS, lambda directory: len(directory.meshes) + 1)
        self.lock = Lock()


class Archives:
    """The zip files of a source. Their members have paths as if the zip were a folder.

    Parameters
    ----------
    root : Path
        The folder of the source.
    limits : Settings
        The limits of archives and uploads.
    read_directory : callable
        Reads the directory of a zip, in a confined process.
    directories : Directories
        The members of archives that earlier scans have read.
    """

    def __init__(
        self, root: Path, limits: Settings, read_directory: ReadDirectory, directories: Directories
    ) -> None:
        self._root, self._limits, self._read_directory = root, limits, read_directory
        self._directories = directories

    def add_members(self, tree: Tree, stopped: Callable[[], bool] = lambda: False) -> int:
        """Add the meshes in the archives of a tree to its files; return how many archives are being written.

        An archive that cannot be read is reported as a folder that cannot be listed.
        """
        moving = 0
        for archive in tree.archives:
            if stopped():
                raise RootMissingError("the scan was stopped")
            try:
                members = self._directory(archive).meshes
            except FileInMotionError:
                moving += 1
                tree.unread[normal(archive.path)] = "the file is being written"
            except ServiceError as error:
                tree.unread[normal(archive.path)] = str(error)
            else:
                for member in members:
                    if not tree.is_ignored(member.path):
                        tree.files.setdefault(normal(member.path), member)
        return moving

    def read(self, found: FoundFile) -> bytes:
        """Return the bytes of a member.

        Raises
        ------
        FileInMotionError, FileUnreadableError
            The archive is being written, or cannot be read.
        MemberError, CoreError
            The member is refused.
        """
        archive = found.archive
        assert archive is not None
        try:
            directory = self._directory(archive)
        except ServiceError as error:
            # The scan has read it once: time or memory is short, or the disk fails.
            raise FileUnreadableError(str(error)) from error
        if found not in directory.meshes:
            raise FileInMotionError
        position, fault = directory.meshes[found]
        if fault is not None:
            raise fault.with_traceback(None)
        with opened(self._root, archive) as file:
            ((_, data),) = directory.archive.on(file).read({position})
        if isinstance(data, bytes):
            return data
        raise data

    @cachedmethod(lambda self: self._directories.read, lock=lambda self: self._directories.lock)
    def _directory(self, archive: FoundFile) -> Directory:
        if archive.size > self._limits.max_archive_bytes:
            raise ArchiveTooLargeError(f"the archive has more than {self._limits.max_archive_bytes} bytes")
        with opened(self._root, archive) as file:
            content = ZipArchive(file, self._limits, self._read_directory)
            members = content.members()
        meshes: dict[FoundFile, tuple[int, MemberFault | None]] = {}
        for position, member in enumerate(members):
            found = _found(archive, member)
            if _is_mesh(member.path) and len(found.path.encode()) <= PATH_BYTES:
                # The frames of its traceback hold all members.
                fault = member.fault and member.fault.with_traceback(None)
                meshes.setdefault(found, (position, fault))
        return Directory(content, meshes)


def _is_mesh(path: str) -> bool:
    """Return whether a member is read: by its ending, and unless it is hidden."""
    parts = path.replace("\\", "/").split("/")
    hidden = any(part.startswith(".") and part != "." for part in parts)
    return not hidden and path.rpartition(".")[2].lower() in endings()


def _found(archive: FoundFile, member: ArchiveMember) -> FoundFile:
    """Return a member as a file. Its inode is made of that of the archive and of its path in it."""
    of_archive = f"{archive.inode} {archive.size} {member.path}".encode(errors="replace")
    inode = int.from_bytes(blake2b(of_archive, digest_size=8).digest(), signed=True)
    return replace(
        archive, path=f"{archive.path}/{member.path}", size=member.size, inode=inode, archive=archive
    )
