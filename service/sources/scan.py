"""One scan of a source: what its folder has, compared with what the archive knows, and stored.

Each transaction leaves a state from which the next scan goes on, so that a scan may end at any time. Changed
files come first, then new paths, then vanished files: a file that was moved has its new path by then.
"""

import threading
import time
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from anyio import to_thread
from starlette.concurrency import run_in_threadpool

from core.errors import CoreError
from service.collection import CollectionNumber
from service.compute.request_queue import together
from service.container import Container
from service.errors import ServiceError
from service.shapes import repository as shapes_repository
from service.shapes.records import NewFile
from service.sources import repository
from service.sources.comparison import Differences, compare, has_lost_half, same_files
from service.sources.reading import FileInMotionError
from service.sources.repository import AT_ONCE, READ_AT_ONCE, KnownFile
from service.sources.schemas import Scan as Report
from service.sources.storing import FileStorer, Places, format_at, keep, named_by_paths
from service.sources.walk import FoundFile, RootMissingError, Tree, find_files
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import SourceRow

T = TypeVar("T")

UNREAD = 100


class OfflineError(Exception):
    """The folder is absent or empty, or has lost more than half of its files; the message tells which."""


class SourceScan:
    """The scan of one source, which this service has claimed; `report` counts what it does.

    `compared_seconds` is the time until the differences from the folder were known; None until then.
    """

    def __init__(self, container: Container, source: SourceRow, places: Places) -> None:
        self._container, self._database, self._places = container, container.database, places
        self._source, self._root = source, Path(source.root)
        self._collection = CollectionNumber(source.collection_number)
        self.report = Report()
        self.compared_seconds: float | None = None
        self._storing = FileStorer(container, source, places, self.report)
        self._stopped = threading.Event()

    async def run(self) -> None:
        """Bring the archive up to the folder.

        Raises
        ------
        OfflineError
            Nothing was taken for deleted.
        SourceLostError
            The source was removed.
        ServiceError
            The database or the workers are not available; the next scan goes on.
        """
        start = time.monotonic()
        try:
            await self._scan()
        finally:
            self._stopped.set()
            self.report.seconds = round(time.monotonic() - start, 3)

    async def _scan(self) -> None:
        start = time.monotonic()
        known = await self._known_files()
        is_expected = any(file.state != "missing" for file in known.values())
        confirmed = self._source.confirmed
        try:
            tree = await to_thread.run_sync(self._find, abandon_on_cancel=True)
        except RootMissingError as error:
            if not is_expected:
                await self._forget_long_missing()
            if not (is_expected and confirmed):
                raise OfflineError(f"the folder cannot be listed: {error}") from error
            tree = Tree()
        self.report.found = len(tree.files)
        self.report.unread = dict(islice(sorted(tree.unread.items()), UNREAD))
        if is_expected and not (tree.files or tree.unread or confirmed):
            raise OfflineError("the folder has no mesh file")
        differences = await run_in_threadpool(compare, known, tree)
        self.compared_seconds = time.monotonic() - start
        await self._settle_unchanged(differences)
        await self._settle_changed(differences)
        await self._settle_new(differences, known)
        await self._settle_vanished(differences.vanished, known, tree)
        await self._tag()
        await self._forget_long_missing()

    def _find(self) -> Tree:
        """Return the files of the folder, and those in its archives."""
        tree = find_files(self._root, self._stopped.is_set)
        self.report.left += self._storing.archives.add_members(tree, self._stopped.is_set)
        return tree

    async def _known_files(self) -> dict[str, KnownFile]:
        """Return what the archive knows, by key; no other scan changes it meanwhile."""
        known: dict[str, KnownFile] = {}
        after = 0
        while files := await self._database.reading(
            repository.known_files, self._source.number, after, READ_AT_ONCE
        ):
            known |= {file.key: file for file in files}
            after = files[-1].number
        return known

    async def _known_at(self, keys: Sequence[str]) -> dict[str, KnownFile]:
        """Return what the archive knows by now of some keys."""
        known: dict[str, KnownFile] = {}
        for batch in _batches(keys):
            files = await self._database.reading(repository.known_at, self._source.number, batch)
            known |= {file.key: file for file in files}
        return known

    async def _settle_unchanged(self, differences: Differences) -> None:
        """Have unchanged files that were missing back, and write other spellings of paths."""
        for batch in _batches(differences.back):
            rows = [
                {
                    "number": file.number,
                    "path": found.path,
                    "state": "present" if file.state == "missing" else file.state,
                    "missing_since": None,
                }
                for file, found in batch
            ]
            await self._database.writing(repository.update_all, rows)

    async def _settle_changed(self, differences: Differences) -> None:
        """Store changed files, after those that were moved over the path of another."""
        self.report.due = len(differences.changed) + len(differences.new)
        read = await self._settle_exchanged(differences)
        self.report.done = len(differences.changed) - len(read)
        await self._each(iter(read), lambda pair: self._storing.settle(pair[0].key, pair[1], pair[0]))

    async def _settle_exchanged(self, differences: Differences) -> list[tuple[KnownFile, FoundFile]]:
        """Return the changed files whose bytes are those of no file that has vanished or changed.

        A file that was moved over the path of another brings its shape. What was at the path has vanished, or
        has the path of the moved file if they changed places.
        """
        movers = {
            file.sha256: file
            for file in [*differences.vanished, *(file for file, _ in differences.changed)]
            if file.sha256 is not None and file.shape_number is not None
        }
        current = {file.number: file for file in movers.values()}
        rest = []
        for earlier, found in differences.changed:
            known = current.get(earlier.number, earlier)
            try:
                file = self._storing.new_file(found, await run_in_threadpool(self._storing.read, found))
            except (CoreError, FileInMotionError, ServiceError):
                rest.append((known, found))
                continue
            digest = await run_in_threadpool(getattr, file, "sha256")
            mover = movers.get(digest)
            if known.sha256 == digest and known.state != "unreadable":
                await self._database.writing(self._storing.touch, found, known, file)
                movers.pop(digest, None)
                self.report.moved += known is not earlier
            elif (
                mover is None
                or mover.number == known.number
                or format_at(mover.path) != format_at(found.path)
            ):
                rest.append((known, found))
            else:
                moved = await self._database.writing(self._exchange, found, known, mover, file)
                current[mover.number] = moved
                del movers[digest]
                if moved.sha256 is not None:
                    movers[moved.sha256] = moved
                self.report.moved += 1
        return [(current.get(known.number, known), found) for known, found in rest]

    async def _settle_new(self, differences: Differences, known: Mapping[str, KnownFile]) -> None:
        """Store new paths: those of known files by their inodes, the others by their bytes."""
        await self._add_known(differences, known)
        heads: dict[tuple[int, ...], str] = {}
        for key, found in differences.new.items():
            heads.setdefault((found.device, *found.same_bytes), key)
        first = {key: differences.new[key] for key in heads.values()}
        await self._each(iter(first.items()), lambda item: self._storing.settle(*item, None))
        if len(first) < len(differences.new):
            for key in first:
                del differences.new[key]
            await self._add_known(differences, await self._known_at(list(first)))

    async def _add_known(self, differences: Differences, known: Mapping[str, KnownFile]) -> None:
        """Add the new paths of known files, and take them from the new ones."""
        same = same_files(known, differences)
        for batch in _batches(list(same.items())):
            rows = [
                {
                    "source_number": self._source.number,
                    "key": key,
                    **repository.as_found(found),
                    "sha256": file.sha256,
                    "shape_number": file.shape_number,
                    "owned": file.owned,
                    "state": "present",
                    "kind": None,
                    "detail": None,
                    "missing_since": None,
                }
                for key, (found, file) in batch
                if format_at(found.path) == format_at(file.path)
            ]
            if rows:
                await self._database.writing(self._add_all, rows)
            for row in rows:
                del differences.new[row["key"]]
            self.report.copies += len(rows)
            self.report.done += len(rows)

    def _add_all(self, session: WriteSession, rows: Sequence[dict[str, Any]]) -> None:
        repository.require(session, self._source.number)
        with named_by_paths(session, self._collection, (row["shape_number"] for row in rows)):
            repository.add_all(session, rows)

    def _exchange(
        self, session: WriteSession, found: FoundFile, known: KnownFile, mover: KnownFile, file: NewFile
    ) -> KnownFile:
        """Exchange the shapes of a path and of the file that was moved there; return that file as it is."""
        repository.require(session, self._source.number)
        names = ("sha256", "shape_number", "owned")
        own, other = ({name: getattr(file, name) for name in names} for file in (known, mover))
        row = {"number": known.number, **repository.as_found(found), "state": "present", **other}
        with named_by_paths(session, self._collection, (known.shape_number, mover.shape_number)):
            repository.update_all(session, [{**row, "kind": None, "detail": None, "missing_since": None}])
            repository.update_all(session, [{"number": mover.number, **own}])
        keep(session, file)
        return replace(mover, **own)

    async def _settle_vanished(
        self, vanished: Sequence[KnownFile], known: dict[str, KnownFile], tree: Tree
    ) -> None:
        """Forget the old paths of moved files, and have the others missing unless too many are."""
        current = await self._known_at([file.key for file in vanished])
        rows = [current[file.key] for file in vanished if file.key in current]
        lost: list[KnownFile] = []
        numbers = {file.number for file in rows}
        for batch in _batches(rows):
            lost += await self._database.writing(self._forget_moved, batch, numbers)
        gone = [file for file in lost if file.state != "missing"]
        if gone and not self._source.confirmed and has_lost_half(known, gone, tree):
            raise OfflineError(f"{len(gone)} files are gone, more than half")
        now = datetime.now(UTC)
        for batch in _batches(gone):
            missing = [{"number": file.number, "state": "missing", "missing_since": now} for file in batch]
            await self._database.writing(repository.update_all, missing)
        self.report.missing = len(gone)

    def _forget_moved(
        self, session: WriteSession, batch: Sequence[KnownFile], vanished: Collection[int]
    ) -> list[KnownFile]:
        """Forget files without a shape, and those whose shape has another path; return the others."""
        shapes = {file.shape_number for file in batch if file.shape_number is not None}
        with_others = repository.with_other_files(session, shapes, vanished)
        for file in batch:
            self.report.moved += file.shape_number in with_others
        lost = [
            file for file in batch if file.shape_number is not None and file.shape_number not in with_others
        ]
        with named_by_paths(session, self._collection, with_others):
            repository.forget(session, {file.number for file in batch} - {file.number for file in lost})
        return lost

    async def _tag(self) -> None:
        """Add the tags of rules that were set since the source was added to the shapes that it has."""
        if self._source.tagged:
            return
        known = await self._known_files()
        for batch in _batches(list(known.values()), AT_ONCE // 5):
            await self._database.writing(self._storing.tag, batch)
        number, rules = self._source.number, self._source.rules
        await self._database.writing(repository.end_tagging, number, rules)

    async def _forget_long_missing(self) -> None:
        """Erase the shapes of files that have been missing for as long as deletions can be undone."""
        until = datetime.now(UTC) - self._container.settings.undo_time
        look = partial(repository.missing_until, number=self._source.number, moment=until, limit=AT_ONCE // 5)

        def erase(session: WriteSession) -> bool:
            numbers = look(session)
            for record in repository.lone_shapes(session, numbers):
                shapes_repository.erase_shape(session, record)
            repository.forget(session, numbers)
            return bool(numbers)

        def any_missing(session: ReadSession) -> bool:
            return bool(look(session))

        while await self._database.reading(any_missing):
            await self._database.writing(erase)

    async def _each(self, items: Iterator[T], work: Callable[[T], Awaitable[None]]) -> None:
        """Work on items, as many at a time as there are workers."""

        async def take() -> None:
            for item in items:
                async with self._places.free:
                    await work(item)

        await together(take() for _ in range(self._container.settings.workers))


def _batches(items: Sequence[T], size: int = AT_ONCE) -> Iterator[Sequence[T]]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
