"""Storing a file of a source: as a shape, as another path of one, or with the reason why it has none."""

import asyncio
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool

from core.errors import CoreError
from core.io import format_of
from service.collection import CollectionNumber
from service.container import Container
from service.errors import (
    BadRequestFieldsError,
    FieldFault,
    FileTimeLimitError,
    FileTooLargeError,
    NameTakenError,
    ServiceError,
    ShapeNotFoundError,
    WorkerLostError,
)
from service.previews import thumbnails
from service.rendering.thumbnail import draw
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes import service as shapes_service
from service.shapes.fields import base_name, clean_name, clean_tags
from service.shapes.records import NewFile, NewShape, StoredShape
from service.shapes.schemas import ShapeChanges
from service.shapes.service import Put, ingest, store_files
from service.sources import repository
from service.sources.archives import Archives, Directories
from service.sources.reading import FileInMotionError, FileUnreadableError, read_file
from service.sources.repository import KnownFile
from service.sources.rules import Rules
from service.sources.schemas import Scan as Report
from service.sources.walk import FoundFile
from service.storage.database import WriteSession
from service.storage.tables import SourceRow

# The size of the pictures in lists.
PICTURE_PIXELS = 256
# Lack of memory, rather than the file, may have killed a worker.
TRIES = 2
# Errors that the file causes.
REFUSED = (CoreError, FileTimeLimitError, BadRequestFieldsError, FileTooLargeError, WorkerLostError)


class Places:
    """The files that the scans of a service read and store at a time: as many as there are workers.

    Each file has one of the `free` places meanwhile.
    """

    def __init__(self, container: Container) -> None:
        self._container = container
        self.free = asyncio.Semaphore(container.settings.workers)
        self.directories = Directories()
        self._active = 0

    @asynccontextmanager
    async def worker(self) -> AsyncIterator[None]:
        """Wait for a worker that no request needs, and count it until the end of the block."""
        await self._container.queue.until_spare(lambda: self._active, lambda: self._active)
        self._active += 1
        try:
            yield
        finally:
            self._active -= 1


class FileStorer:
    """Stores the files of one source during a scan, and counts them in its `report`."""

    def __init__(self, container: Container, source: SourceRow, places: Places, report: Report) -> None:
        self._container, self._database, self._places = container, container.database, places
        self._source, self._root, self._report = source, Path(source.root), report
        self._collection = CollectionNumber(source.collection_number)
        self._locks: dict[str, asyncio.Lock] = {}
        self._rules = Rules(source.rules)
        self.archives = Archives(
            self._root, container.settings, container.queue.zip_directory, places.directories
        )

    async def settle(self, key: str, found: FoundFile, known: KnownFile | None) -> None:
        """Read a file, and store it unless its bytes are known."""
        try:
            data = await run_in_threadpool(self.read, found)
        except FileInMotionError:
            self._report.left += 1
            return
        except (CoreError, ServiceError) as error:
            await self._refuse(key, found, known, None, error)
            self._report.done += 1
            return
        file = self.new_file(found, data)
        digest = await run_in_threadpool(getattr, file, "sha256")
        async with self._alone(digest):
            for tries_left in reversed(range(TRIES)):
                try:
                    await self._store(key, found, known, file)
                    break
                except REFUSED as error:
                    if not (isinstance(error, WorkerLostError) and tries_left):
                        await self._refuse(key, found, known, digest, error)
                        break
        self._report.done += 1

    def new_file(self, found: FoundFile, data: bytes) -> NewFile:
        """Return the file at a path, which stays in place unless it is in an archive, or copies are kept."""
        in_place = not self._source.copies and found.archive is None
        return NewFile(data, format_at(found.path), in_place=in_place)

    def read(self, found: FoundFile) -> bytes:
        """Return the bytes of a file, or of a member of an archive; see `read_file` and `Archives.read`."""
        if found.archive is not None:
            return self.archives.read(found)
        return read_file(self._root, found, self._container.settings.max_upload_bytes)

    async def _store(self, key: str, found: FoundFile, known: KnownFile | None, file: NewFile) -> None:
        """Store a file as the shape of its path, or as another path of the shape that has its bytes."""
        if known is not None and await self._replace(key, found, known, file):
            return
        shape = await self._database.reading(
            repository.shape_with, self._collection, file.sha256, file.format
        )
        if shape is not None and shape.deleted and shape.removed:
            # The source of the shape was removed: adding the folder again brings it back.
            with suppress(CoreError, NameTakenError, ShapeNotFoundError):
                await shapes_service.restore(
                    self._container, self._collection, shape.id, in_place=file.in_place
                )
        if shape is not None:
            values = _present(file, shape.number, owned=shape.owned)
            await self._database.writing(self._put, key, found, known, values, file)
            self._report.copies += 1
            return
        await self._ingest(key, found, known, file)

    async def _ingest(self, key: str, found: FoundFile, known: KnownFile | None, file: NewFile) -> None:
        """Store a file as a new shape, by the name of the file."""
        try:
            name = clean_name(base_name(found.path))
        except ValueError as error:
            raise BadRequestFieldsError(FieldFault("name", str(error))) from error
        new = NewShape(
            file.data,
            file.format,
            self._collection,
            name,
            self._tags_of(found.path),
            {},
            in_place=file.in_place,
        )

        def record(session: WriteSession, stored: StoredShape) -> None:
            values = _present(file, stored.shape.number, owned=stored.created)
            self._put(session, key, found, known, values)

        async with self._places.worker():
            await ingest(self._container, new, also=record)
            await self._draw(file)
        self._report.stored += 1

    def _tags_of(self, path: str) -> tuple[str, ...]:
        """Return the tags of a new shape: those of the source, and those of the rules that its path meets."""
        try:
            return tuple(clean_tags([*self._source.tags, *self._rules.tags_of(path)]))
        except ValueError as error:
            raise BadRequestFieldsError(FieldFault("tags", str(error))) from error

    def tag(self, session: WriteSession, files: Sequence[KnownFile]) -> None:
        """Add the tags of the rules to the shapes that the source stored for some files."""
        tags: dict[int, list[str]] = {}
        for file in files:
            if file.shape_number is not None and file.owned:
                tags.setdefault(file.shape_number, []).extend(self._rules.tags_of(file.path))
        shapes = [number for number, wanted in tags.items() if wanted]
        for record in shapes_repository.records(session, self._collection, shapes):
            # More than a shape may have are refused.
            with suppress(ValueError):
                joined = clean_tags([*record.tags, *tags[record.number]])
                if joined != list(record.tags):
                    shapes_repository.change(session, record.number, {"tags": joined})

    async def _replace(self, key: str, found: FoundFile, known: KnownFile, file: NewFile) -> bool:
        """Give the shape of a path its changed file; return whether the path has its shape."""
        if known.shape_number is None or not known.owned:
            return False
        number = known.shape_number
        if await self._database.reading(repository.others_with, number, known.number):
            return False

        def store(session: WriteSession, put: Put) -> bool:
            record = next(iter(shapes_repository.records(session, self._collection, [number])), None)
            if record is None:
                return False
            holder = shapes_repository.same(session, self._collection, file, record.name)
            if holder is not None and holder.number != number:
                return False
            if holder is None:
                shapes_repository.replace_file(session, record, file.format, put(file))
            self._put(session, key, found, known, _present(file, number, owned=True))
            return True

        async with self._places.worker():
            replaced, _ = await store_files(self._container, [file], store)
            await self._draw(file)
        self._report.changed += replaced
        return replaced

    async def _draw(self, file: NewFile) -> None:
        """Draw the picture of a file that the archive does not keep: its folder may be away later."""
        if not file.in_place:
            return
        with suppress(CoreError, ServiceError):
            mesh = await self._container.queue.read(file.data, file.format)
            picture = await self._container.queue.do(draw, mesh, file.format, PICTURE_PIXELS)
            await thumbnails.store(self._container, {file.key: picture}, PICTURE_PIXELS)

    def touch(self, session: WriteSession, found: FoundFile, known: KnownFile, file: NewFile) -> None:
        """Write the time and the inode of a file whose bytes are unchanged."""
        state = "present" if known.state == "missing" else known.state
        row = {"number": known.number, **repository.as_found(found), "state": state, "missing_since": None}
        repository.update_all(session, [row])
        keep(session, file)

    def _put(
        self,
        session: WriteSession,
        key: str,
        found: FoundFile,
        known: KnownFile | None,
        values: Mapping[str, Any],
        file: NewFile | None = None,
    ) -> None:
        repository.require(session, self._source.number)
        if known is not None and known.shape_number != values["shape_number"]:
            # The shape of the path is deleted, unless another path has it.
            for record in repository.lone_shapes(session, [known.number]):
                shapes_service.delete(
                    session, self._collection, record.id, self._container.settings.undo_time
                )
        shapes = values["shape_number"], None if known is None else known.shape_number
        with named_by_paths(session, self._collection, shapes):
            repository.write(session, self._source.number, key, found, known, values)
        if file is not None:
            keep(session, file)

    async def _refuse(
        self, key: str, found: FoundFile, known: KnownFile | None, sha256: str | None, error: Exception
    ) -> None:
        """Write why a file has no shape. The shape that its path had stays."""
        assert isinstance(error, CoreError | ServiceError)
        values: dict[str, Any] = {
            "sha256": sha256,
            "shape_number": None if known is None else known.shape_number,
            "owned": known is not None and known.owned,
            "state": "unreadable" if isinstance(error, FileUnreadableError) else "refused",
            "kind": error.kind,
            "detail": str(error)[: repository.DETAIL_CHARACTERS],
        }
        if isinstance(error, FileUnreadableError) and known is not None:
            values["sha256"] = known.sha256
        await self._database.writing(self._put, key, found, known, values)
        self._report.refused += 1

    @asynccontextmanager
    async def _alone(self, sha256: str) -> AsyncIterator[None]:
        """Let one of the files with the same bytes be stored at a time: the next finds its shape."""
        lock = self._locks.setdefault(sha256, asyncio.Lock())
        async with lock:
            yield
        if not lock.locked():
            self._locks.pop(sha256, None)


@contextmanager
def named_by_paths(
    session: WriteSession, collection: CollectionNumber, shapes: Iterable[int | None]
) -> Iterator[None]:
    """Give shapes whose files the block writes the names of their first files.

    A shape that had not the name of its first file keeps its own, as does one whose new name is taken.
    """
    numbers = {number for number in shapes if number is not None}
    before = repository.first_paths(session, numbers)
    yield
    after = repository.first_paths(session, before)
    moved = {number: path for number, path in after.items() if path != before[number]}
    for record in shapes_repository.records(session, collection, list(moved)):
        with suppress(ValueError, NameTakenError):
            if record.name == clean_name(base_name(before[record.number])):
                changes = ShapeChanges(name=clean_name(base_name(moved[record.number])))
                shapes_service.change(session, collection, record.id, changes, collection)


def keep(session: WriteSession, file: NewFile) -> None:
    """Store the bytes of a file that does not stay in place, if its shape was stored without them."""
    number = None if file.in_place else file_repository.blob_number(session, file.sha256)
    if number is not None:
        file_repository.keep_bytes(session, number, file.data)


def _present(file: NewFile, shape_number: int, *, owned: bool) -> dict[str, Any]:
    """Return the columns of a file that is a shape."""
    return {"sha256": file.sha256, "shape_number": shape_number, "owned": owned, "state": "present"}


def format_at(path: str) -> str:
    """Return the format of the file at a path."""
    return format_of(base_name(path))
