"""The SQL of files that are there more than once, by their bytes or by merges of their shapes."""

from collections.abc import Collection, Iterable, Iterator
from datetime import datetime
from itertools import islice
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import Select, func, select

from service.collection import CollectionNumber
from service.storage.database import ReadSession
from service.storage.tables import BlobRow, DuplicateMergeRow, ShapeRow, SourceFileRow, SourceRow

T = TypeVar("T")

AT_ONCE = 1_000
"""Values that one statement is given."""

Identity = tuple[str | None, int, int, int]
"""SHA-256, inode, size and time of change: the same for all paths of one file.

The device is left out: it differs between two mounts of one folder, and after a restart of the system.
"""

_IDENTITY = (SourceFileRow.sha256, SourceFileRow.inode, SourceFileRow.size, SourceFileRow.mtime_ns)


class PresentFile(NamedTuple):
    """A file of a source that is ready, with the place of the source and of the file in it."""

    shape: int
    source_id: str
    root: str
    path: str
    place: tuple[int, str]
    sha256: str
    inode: int
    size: int
    mtime_ns: int

    @property
    def identity(self) -> Identity:
        """The values that all paths of the file share."""
        return self.sha256, self.inode, self.size, self.mtime_ns

    @property
    def is_in_zip(self) -> bool:
        """Whether the file is a member of a zip. A folder with such a name counts as a zip."""
        return any(part.lower().endswith(".zip") for part in self.path.split("/")[:-1])


def _present(query: Select[*tuple[Any, ...]], collection: CollectionNumber) -> Select[*tuple[Any, ...]]:
    """Return a query of files whose source was scanned to its end and has them, with their shapes' bytes."""
    return (
        query.select_from(SourceFileRow)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .join(ShapeRow, ShapeRow.number == SourceFileRow.shape_number)
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .where(SourceFileRow.state == "present", SourceFileRow.sha256 == BlobRow.sha256)
        .where(SourceRow.state == "ready", ~SourceRow.requested, SourceRow.removed_at.is_(None))
        .where(SourceRow.collection_number == collection, ShapeRow.collection_number == collection)
    )


def counts_of_several(session: ReadSession, collection: CollectionNumber) -> dict[int, int]:
    """Return the numbers of files of the shapes, deleted ones too, that have several."""
    query = _present(select(ShapeRow.number, func.count()), collection).group_by(ShapeRow.number)
    return dict(session.execute(query.having(func.count() > 1)).all())


def files_of(
    session: ReadSession, collection: CollectionNumber, shapes: Collection[int]
) -> list[PresentFile]:
    """Return the files of some shapes, in the order of the sources and of the paths in each."""
    columns = ShapeRow.number, SourceRow.id, SourceRow.root, SourceFileRow.path
    query = _present(select(*columns, SourceRow.number, SourceFileRow.key, *_IDENTITY), collection)
    files = [
        PresentFile(shape, source_id, root, path, (source, key), *identity)
        for some in _batches(shapes)
        for shape, source_id, root, path, source, key, *identity in session.execute(
            query.where(ShapeRow.number.in_(some))
        )
    ]
    return sorted(files, key=lambda file: file.place)


def of_several_paths(session: ReadSession, hashes: Collection[str]) -> set[Identity]:
    """Return the files with some SHA-256 that sources, of any collection, have by several paths."""
    query = (
        select(*_IDENTITY)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceRow.removed_at.is_(None), SourceFileRow.state != "missing")
        .group_by(*_IDENTITY)
        .having(func.count() > 1)
    )
    return {
        (sha256, inode, size, mtime_ns)
        for some in _batches(hashes)
        for sha256, inode, size, mtime_ns in session.execute(query.where(SourceFileRow.sha256.in_(some)))
    }


class _Merge(NamedTuple):
    """A merge, by the columns of `DuplicateMergeRow`."""

    number: int
    shape: str
    sha256: str
    merged_at: datetime


class _Shape(NamedTuple):
    """A shape, deleted or not, and its file."""

    number: int
    deleted_at: datetime | None
    sha256: str


def merged(session: ReadSession, collection: CollectionNumber) -> dict[int, int]:
    """Return the shapes that stayed, by the shapes that were merged into them.

    Merges are followed to the last one. One does not count if it was undone, if its deleted shape was
    restored or erased, or if the shape that stayed was deleted, or got another file since: nobody has
    compared that file.
    """
    row = DuplicateMergeRow
    query = select(row.number, row.shape, row.sha256, row.deleted, row.merged_at)
    query = query.where(row.collection_number == collection).order_by(row.number)
    latest = {
        deleted: _Merge(number, shape, sha256, merged_at)
        for number, shape, sha256, all_deleted, merged_at in session.execute(query)
        for deleted in all_deleted
    }
    shapes = _shapes(session, collection, {*latest, *(each.shape for each in latest.values())})

    def holds(shape: str, merge: _Merge) -> bool:
        if shape not in shapes or merge.shape not in shapes:
            return False
        deleted_at = shapes[shape].deleted_at
        is_deleted_by_it = deleted_at is not None and deleted_at <= merge.merged_at
        return is_deleted_by_it and shapes[merge.shape].sha256 == merge.sha256

    stayed: dict[int, int] = {}
    for shape in latest:
        last, number = shape, 0
        while (merge := latest.get(last)) and merge.number > number and holds(last, merge):
            last, number = merge.shape, merge.number
        if last != shape and shapes[last].deleted_at is None:
            stayed[shapes[shape].number] = shapes[last].number
    return stayed


def _shapes(session: ReadSession, collection: CollectionNumber, ids: Collection[str]) -> dict[str, _Shape]:
    query = (
        select(ShapeRow.id, ShapeRow.number, ShapeRow.deleted_at, BlobRow.sha256)
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .where(ShapeRow.collection_number == collection)
    )
    return {
        shape_id: _Shape(number, deleted_at, sha256)
        for some in _batches(ids)
        for shape_id, number, deleted_at, sha256 in session.execute(query.where(ShapeRow.id.in_(some)))
    }


def _batches(values: Iterable[T]) -> Iterator[list[T]]:
    remaining = iter(values)
    while some := list(islice(remaining, AT_ONCE)):
        yield some
