"""The SQL of sources and their files."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Row, bindparam, delete, false, func, insert, or_, select, update
from sqlalchemy.orm import aliased

from service.collection import CollectionNumber
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeRecord
from service.shapes.word_repository import index_words
from service.sources.schemas import FileState
from service.sources.walk import FoundFile
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import NOT_DELETED, BlobRow, ShapeRow, SourceFileRow, SourceRow

AT_ONCE = 500
"""Rows that one transaction writes, so that other writers wait for a moment only."""

READ_AT_ONCE = 2_000
"""Rows that one transaction reads: writers of SQLite's rollback journal wait for readers."""

# Without renewal for this long, a service counts as dead and others may scan the source.
LEASE = timedelta(seconds=15)
# A lease that ends later was written before the clock was set back.
LONGEST_LEASE = timedelta(minutes=10)
DETAIL_CHARACTERS = 1_000

_KEPT = SourceRow.removed_at.is_(None)


class SourceLostError(Exception):
    """The source was removed, or another service scans it."""


@dataclass(frozen=True, slots=True)
class KnownFile:
    """A file of a source as the archive knows it; the columns of `SourceFileRow`."""

    number: int
    path: str
    key: str
    size: int
    mtime_ns: int
    inode: int
    sha256: str | None
    shape_number: int | None
    owned: bool
    state: str

    @property
    def same_bytes(self) -> tuple[int, int, int]:
        """The values of `FoundFile.same_bytes`."""
        return self.inode, self.size, self.mtime_ns


_KNOWN = select(*(getattr(SourceFileRow, name) for name in KnownFile.__dataclass_fields__))


def add(session: WriteSession, collection: CollectionNumber, values: Mapping[str, Any]) -> SourceRow:
    """Add a source, which waits for its first scan."""
    row = SourceRow(
        collection_number=collection,
        state="waiting",
        report={},
        tagged=True,
        requested=True,
        confirmed=False,
        created_at=datetime.now(UTC),
        **values,
    )
    session.add(row)
    session.flush()
    return row


def by_id(session: ReadSession, collection: CollectionNumber, source_id: str) -> SourceRow | None:
    """Return the source of a collection with an id."""
    query = select(SourceRow).where(
        SourceRow.collection_number == collection, SourceRow.id == source_id, _KEPT
    )
    return session.scalars(query).one_or_none()


def listed(session: ReadSession, collection: CollectionNumber | None = None) -> Sequence[SourceRow]:
    """Return the sources of a collection, or of all, by name."""
    query = select(SourceRow).where(_KEPT).order_by(SourceRow.name, SourceRow.number)
    return session.scalars(
        query if collection is None else query.where(SourceRow.collection_number == collection)
    ).all()


def counts(session: ReadSession, number: int) -> dict[str, int]:
    """Return the numbers of a source's files by state."""
    query = select(SourceFileRow.state, func.count()).where(SourceFileRow.source_number == number)
    return {state: many for state, many in session.execute(query.group_by(SourceFileRow.state))}  # noqa: C416


def files(
    session: ReadSession,
    number: int,
    state: FileState | None,
    shape_ids: Sequence[str],
    *,
    equal: bool,
    after: int,
    limit: int,
) -> tuple[int, list[Row[SourceFileRow, str | None]]]:
    """Return the number of a source's files in a state and of some shapes, and the next ones.

    With `equal`, these are present files whose shapes have other present files, ordered by shape. They come
    after the file with the number `after`, each with the id of its shape.
    """
    wanted = [SourceFileRow.source_number == number]
    following: ColumnElement[bool] = SourceFileRow.number > after
    order: list[Any] = [SourceFileRow.number]
    if equal:
        other = aliased(SourceFileRow)
        twin = select(other.number).join(SourceRow, SourceRow.number == other.source_number)
        twin = twin.where(other.shape_number == SourceFileRow.shape_number, other.state == "present", _KEPT)
        twin = twin.where(other.number != SourceFileRow.number).correlate(SourceFileRow)
        wanted += [SourceFileRow.state == "present", twin.exists()]
        order.insert(0, SourceFileRow.shape_number)
        if after:
            last = select(SourceFileRow.shape_number).where(SourceFileRow.number == after).scalar_subquery()
            of_last = (SourceFileRow.shape_number == last) & following
            following = (SourceFileRow.shape_number > last) | of_last
    if state is not None:
        wanted.append(SourceFileRow.state == state)
    if shape_ids:
        numbers = select(ShapeRow.number).where(ShapeRow.id.in_(shape_ids))
        wanted.append(SourceFileRow.shape_number.in_(numbers))
    total = session.scalars(select(func.count()).select_from(SourceFileRow).where(*wanted)).one()
    shape = (ShapeRow.number == SourceFileRow.shape_number) & NOT_DELETED
    query = (
        select(SourceFileRow, ShapeRow.id)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .outerjoin(ShapeRow, shape & (ShapeRow.collection_number == SourceRow.collection_number))
        .where(*wanted, following)
        .order_by(*order)
        .limit(limit)
    )
    return total, list(session.execute(query))


def change(session: WriteSession, number: int, values: Mapping[str, Any]) -> None:
    """Write columns of a source."""
    session.execute(update(SourceRow).where(SourceRow.number == number).values(values))


def claim(session: WriteSession, number: int, runner: str) -> SourceRow | None:
    """Take over a source that no living service scans, for a scan; None if there is none."""
    now = datetime.now(UTC)
    is_over = or_(SourceRow.leased_until <= now, SourceRow.leased_until > now + LONGEST_LEASE)
    free = or_(SourceRow.leased_until.is_(None), is_over)
    row = session.scalars(select(SourceRow).where(SourceRow.number == number, _KEPT, free)).one_or_none()
    if row is not None:
        row.runner, row.leased_until = runner, now + LEASE
        row.state, row.requested, row.report = "scanning", False, {}
    return row


def is_abandoned(source: SourceRow) -> bool:
    """Return whether the service that began the scan of a source has died."""
    until = source.leased_until
    return source.state == "scanning" and until is not None and until <= datetime.now(UTC)


def renew(session: WriteSession, number: int, runner: str, report: Mapping[str, Any]) -> None:
    """Renew the lease of a scan, and write its counts.

    Raises
    ------
    SourceLostError
    """
    lease = update(SourceRow).where(SourceRow.number == number, SourceRow.runner == runner, _KEPT)
    values = {"leased_until": datetime.now(UTC) + LEASE, "report": dict(report)}
    if session.execute(lease.values(values).returning(SourceRow.number)).one_or_none() is None:
        raise SourceLostError


def release(session: WriteSession, number: int, runner: str, values: Mapping[str, Any]) -> None:
    """End a scan, with columns of the source that it leaves."""
    mine = update(SourceRow).where(SourceRow.number == number, SourceRow.runner == runner)
    session.execute(mine.values(runner=None, leased_until=None, **values))


def require(session: ReadSession, number: int) -> None:
    """Raise SourceLostError if the source was removed."""
    if session.scalar(select(SourceRow.number).where(SourceRow.number == number, _KEPT)) is None:
        raise SourceLostError


def known_files(session: ReadSession, number: int, after: int, limit: int) -> list[KnownFile]:
    """Return the next files of a source after one."""
    query = _KNOWN.where(SourceFileRow.source_number == number, SourceFileRow.number > after)
    return [KnownFile(*row) for row in session.execute(query.order_by(SourceFileRow.number).limit(limit))]


def known_at(session: ReadSession, number: int, keys: Sequence[str]) -> list[KnownFile]:
    """Return the files of a source with some keys."""
    query = _KNOWN.where(SourceFileRow.source_number == number, SourceFileRow.key.in_(keys))
    return [KnownFile(*row) for row in session.execute(query)]


def write(
    session: WriteSession,
    source: int,
    key: str,
    found: FoundFile,
    known: KnownFile | None,
    values: Mapping[str, Any],
) -> None:
    """Write a file as it was found, with further columns, in place of what was known of its path."""
    columns = {**as_found(found), "kind": None, "detail": None, "missing_since": None, **values}
    (columns,) = _without_erased(session, [columns])
    before = set() if known is None else _shapes_of(session, [known.number])
    if known is not None:
        session.execute(update(SourceFileRow).where(SourceFileRow.number == known.number).values(columns))
    else:
        session.execute(insert(SourceFileRow).values(source_number=source, key=key, **columns))
    index_words(session, before | _shapes_in([columns]))


def add_all(session: WriteSession, rows: Sequence[Mapping[str, Any]]) -> None:
    """Add files; `rows` have all columns."""
    written = _without_erased(session, rows)
    session.execute(insert(SourceFileRow), written)
    index_words(session, _shapes_in(written))


def update_all(session: WriteSession, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the same columns of several files, each given with its `number`, unless they were deleted."""
    values = [{"of_file": row.pop("number"), **row} for row in _without_erased(session, rows)]
    of_file = SourceFileRow.number == bindparam("of_file")
    moved = [row["of_file"] for row in values if not row.keys().isdisjoint({"path", "shape_number"})]
    before = _shapes_of(session, moved)
    session.connection().execute(update(SourceFileRow).where(of_file), values)
    index_words(session, before | _shapes_in(values))


def _shapes_of(session: ReadSession, numbers: Collection[int]) -> set[int]:
    """Return the shapes of some files, whose words have those of the paths."""
    shapes = select(SourceFileRow.shape_number).where(SourceFileRow.number.in_(numbers))
    return {shape for shape in session.scalars(shapes) if shape is not None}


def _shapes_in(rows: Iterable[Mapping[str, Any]]) -> set[int]:
    """Return the shapes in columns of files."""
    return {row["shape_number"] for row in rows if row.get("shape_number") is not None}


def _without_erased(session: ReadSession, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return columns of files, with null for shapes that were erased after they had been read."""
    shapes = {row.get("shape_number") for row in rows} - {None}
    if not shapes:
        return [dict(row) for row in rows]
    present = set(session.scalars(select(ShapeRow.number).where(ShapeRow.number.in_(shapes))))
    return [
        {**row, "shape_number": row["shape_number"] if row["shape_number"] in present else None}
        for row in rows
    ]


def forget(session: WriteSession, numbers: Collection[int]) -> None:
    """Delete files, but not their shapes."""
    shapes = _shapes_of(session, numbers)
    session.execute(delete(SourceFileRow).where(SourceFileRow.number.in_(numbers)))
    index_words(session, shapes)


def forget_refused(session: WriteSession, number: int, kind: str) -> None:
    """Delete files without a shape that were refused for a reason, so that the next scan reads them again."""
    lacking = SourceFileRow.shape_number.is_(None)
    refused = SourceFileRow.state == "refused", SourceFileRow.kind == kind, lacking
    session.execute(delete(SourceFileRow).where(SourceFileRow.source_number == number, *refused))


def end_tagging(session: WriteSession, number: int, rules: Mapping[str, Any]) -> None:
    """Write that the shapes of a source have the tags of its rules, unless it has other rules by now."""
    source = session.scalars(select(SourceRow).where(SourceRow.number == number)).one()
    source.tagged = source.rules == rules


def as_found(found: FoundFile) -> dict[str, Any]:
    """Return the columns of a file that its folder tells."""
    return {name: getattr(found, name) for name in ("path", "size", "mtime_ns", "device", "inode")}


def shape_with(
    session: ReadSession, collection: CollectionNumber, sha256: str, format: str
) -> Row[int, str, bool, bool, bool] | None:
    """Return the shape of some bytes: `number`, `id`, `owned`, `deleted` and `removed`.

    Shapes of sources come before those of uploads, and stored ones before deleted ones, of which only sources
    have any. `deleted` tells that it is deleted, and `removed` that its source was removed.
    """
    deleted = ShapeRow.deleted_at.is_not(None)
    query = (
        select(
            ShapeRow.number,
            ShapeRow.id,
            SourceFileRow.owned,
            deleted.label("deleted"),
            SourceRow.removed_at.is_not(None).label("removed"),
        )
        .select_from(SourceFileRow)
        .join(ShapeRow, ShapeRow.number == SourceFileRow.shape_number)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceFileRow.sha256 == sha256, ShapeRow.format == format)
        .where(ShapeRow.collection_number == collection)
        .order_by(deleted, SourceFileRow.number)
        .limit(1)
    )
    in_source = session.execute(query).one_or_none()
    if in_source is not None and not in_source.deleted:
        return in_source
    uploaded = (
        select(
            ShapeRow.number,
            ShapeRow.id,
            false().label("owned"),
            false().label("deleted"),
            false().label("removed"),
        )
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .where(BlobRow.sha256 == sha256, ShapeRow.format == format)
        .where(ShapeRow.collection_number == collection, NOT_DELETED)
        .order_by(ShapeRow.number)
        .limit(1)
    )
    return session.execute(uploaded).one_or_none() or in_source


def others_with(session: ReadSession, shape_number: int, number: int) -> int:
    """Return how many other files than one have a shape."""
    query = select(func.count()).where(
        SourceFileRow.shape_number == shape_number, SourceFileRow.number != number
    )
    return session.scalar(query) or 0


def with_other_files(session: ReadSession, shapes: Iterable[int], besides: Collection[int]) -> set[int]:
    """Return those of some shapes that have files, not missing, besides some."""
    query = (
        select(SourceFileRow.shape_number, SourceFileRow.number)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceFileRow.shape_number.in_(list(shapes)), SourceFileRow.state != "missing", _KEPT)
    )
    return {shape for shape, number in session.execute(query) if shape is not None and number not in besides}


def first_paths(session: ReadSession, shapes: Iterable[int]) -> dict[int, str]:
    """Return the path of the first file of shapes that sources stored, by shape.

    The files of a shape are in the order of their sources, then of their paths.
    """
    files = SourceFileRow.__table__.alias()
    first = (
        select(files.c.number)
        .join(SourceRow, SourceRow.number == files.c.source_number)
        .where(files.c.shape_number == ShapeRow.number, _KEPT)
        .order_by(files.c.source_number, files.c.key)
        .limit(1)
        .scalar_subquery()
    )
    query = (
        select(ShapeRow.number, SourceFileRow.path)
        .join(SourceFileRow, SourceFileRow.number == first)
        .where(ShapeRow.number.in_(list(shapes)), SourceFileRow.owned)
    )
    return {shape: path for shape, path in session.execute(query)}  # noqa: C416


def missing_until(session: ReadSession, number: int, moment: datetime, limit: int) -> Sequence[int]:
    """Return at most `limit` files of a source that are missing since a time, or longer."""
    query = select(SourceFileRow.number).where(
        SourceFileRow.source_number == number,
        SourceFileRow.state == "missing",
        SourceFileRow.missing_since <= moment,
    )
    return session.scalars(query.order_by(SourceFileRow.number).limit(limit)).all()


def some_files(session: ReadSession, number: int, after: int, limit: int) -> Sequence[int]:
    """Return the next files of a source after one."""
    query = select(SourceFileRow.number).where(
        SourceFileRow.source_number == number, SourceFileRow.number > after
    )
    return session.scalars(query.order_by(SourceFileRow.number).limit(limit)).all()


def lone_shapes(session: ReadSession, numbers: Collection[int]) -> list[ShapeRecord]:
    """Return the shapes that sources stored for some files, and that no other file of a source has.

    A shape that was moved to another collection than that of the source is left out.
    """
    other = SourceFileRow.__table__.alias()
    elsewhere = (
        select(other.c.number)
        .join(SourceRow, SourceRow.number == other.c.source_number)
        .where(other.c.shape_number == SourceFileRow.shape_number, other.c.number.not_in(numbers), _KEPT)
        .correlate(SourceFileRow)
    )
    query = (
        select(ShapeRow.collection_number, ShapeRow.number)
        .join(SourceFileRow, SourceFileRow.shape_number == ShapeRow.number)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(ShapeRow.collection_number == SourceRow.collection_number)
        .where(SourceFileRow.number.in_(numbers), SourceFileRow.owned, NOT_DELETED, ~elsewhere.exists())
        .distinct()
    )
    by_collection: dict[int, list[int]] = {}
    for collection, shape in session.execute(query):
        by_collection.setdefault(collection, []).append(shape)
    return [
        record
        for collection, shapes in by_collection.items()
        for record in shapes_repository.records(session, CollectionNumber(collection), shapes)
    ]


def removed(session: ReadSession) -> Sequence[SourceRow]:
    """Return the sources that were removed."""
    return session.scalars(select(SourceRow).where(~_KEPT).order_by(SourceRow.number)).all()


def erase(session: WriteSession, number: int) -> None:
    """Delete a source, whose files are forgotten."""
    session.execute(delete(SourceRow).where(SourceRow.number == number))


def collection_of(session: ReadSession, number: int) -> CollectionNumber:
    """Return the collection of a source."""
    query = select(SourceRow.collection_number).where(SourceRow.number == number)
    return CollectionNumber(session.scalars(query).one())
