"""Watching folders for changes by the events of the system, where their file systems send any."""

import asyncio
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from starlette.concurrency import run_in_threadpool

from service.compute.request_queue import end
from service.observability.logging import get_logger
from service.sources.walk import IGNORE, is_read

log = get_logger("sources")

DEBOUNCE_MILLISECONDS = 1_000
"""The longest time for which changes are gathered into one report."""

SILENT = ("nfs", "cifs", "smb", "fuse", "9p", "virtiofs", "afs", "ceph", "glusterfs", "vboxsf", "prl_fs")
"""The beginnings of the names of file systems that send no events for changes by other machines."""

MOUNTS = Path("/proc/self/mountinfo")


def reporting(roots: Mapping[int, str]) -> dict[int, str]:
    """Return those of some folders whose changes the system reports: they are there, on a local disk."""
    try:
        mounts = MOUNTS.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        mounts = []
    # A network mount is not asked: one whose server is away would not answer.
    return {
        number: root
        for number, root in roots.items()
        if not file_system(mounts, root).startswith(SILENT) and os.path.isdir(root)
    }


def file_system(mounts: list[str], root: str) -> str:
    """Return the type of a folder's file system, from the lines of proc(5) mountinfo; empty if unknown."""
    longest, kind = -1, ""
    for line in mounts:
        before, _, after = line.partition(" - ")
        fields, types = before.split(), after.split()
        if len(fields) < 5 or not types:
            continue
        point = _unescaped(fields[4])
        # The last of several mounts at one point hides the others.
        if Path(root).is_relative_to(point) and len(point) >= longest:
            longest, kind = len(point), types[0]
    return kind


def _unescaped(point: str) -> str:
    """Return a mount point with the spaces, tabs, line ends and backslashes that mountinfo escapes."""
    for code, character in (("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")):
        point = point.replace(code, character)
    return point


def _may_matter(_change: object, path: str) -> bool:
    """Return whether a changed path may be a mesh, a folder or the patterns; others change all the time."""
    name = os.path.basename(path)
    return "." not in name or is_read(name) or name == IGNORE or os.path.isdir(path)


class Watch:
    """The watch on the folders of several sources, by one thread; none without folders to watch.

    Parameters
    ----------
    changed : callable
        Called with the number of a source when its folder has changed.
    """

    def __init__(self, changed: Callable[[int], object]) -> None:
        self._changed = changed
        self._roots: dict[int, str] = {}
        self._known: set[int] = set()
        self._failed = False
        self._watching: asyncio.Task[None] | None = None

    def follows(self, number: int) -> bool:
        """Return whether changes of a source's folder are reported."""
        return number in self._roots and not self._failed

    async def follow(self, roots: Mapping[int, str]) -> None:
        """Watch these folders, by the numbers of their sources, if the system reports their changes.

        A folder that is gone, or there again, has changed.
        """
        local = await run_in_threadpool(reporting, roots) if roots else {}
        if local != self._roots:
            await self.stop()
            for number in (local.keys() ^ self._roots.keys()) & self._known & roots.keys():
                self._changed(number)
            self._roots, self._failed = local, False
            if local:
                self._watching = asyncio.create_task(self._watch(local))
        self._known = set(roots)

    async def stop(self) -> None:
        """Stop watching."""
        if self._watching is not None:
            await end(self._watching)
            self._watching = None

    async def _watch(self, roots: Mapping[int, str]) -> None:
        # Here, so that a service without sources does not load it.
        from watchfiles import awatch  # noqa: PLC0415

        try:
            async for changes in awatch(
                *roots.values(),
                debounce=DEBOUNCE_MILLISECONDS,
                watch_filter=_may_matter,
                ignore_permission_denied=True,
            ):
                for number, root in roots.items():
                    if any(Path(path).is_relative_to(root) for _, path in changes):
                        self._changed(number)
        except (OSError, RuntimeError) as error:
            # Such as a limit of the system on watches.
            self._failed = True
            log.warning("folders are not watched, but scanned from time to time: %s", error)
