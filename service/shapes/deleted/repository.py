"""The SQL of deleted shapes."""

from datetime import datetime

from sqlalchemy import ColumnElement, delete, func, select, update

from service.collection import CollectionNumber
from service.shapes.deleted.records import DeletedRecord
from service.shapes.records import ShapeRecord
from service.storage.checksums import whole_file
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import BlobRow, DeletedRow


def keep(session: WriteSession, collection: CollectionNumber, record: ShapeRecord, now: datetime) -> None:
    """Copy a shape and its bytes to the table of deleted shapes. The database copies the bytes itself."""
    row = DeletedRow(
        id=record.id,
        collection_number=collection,
        name=record.name,
        tags=list(record.tags),
        meta=dict(record.metadata),
        format=record.format,
        sha256=record.sha256,
        size=record.size,
        created_at=record.created_at,
        deleted_at=now,
        data=b"",
    )
    session.add(row)
    session.flush()
    data = select(BlobRow.data).where(BlobRow.sha256 == record.sha256).scalar_subquery()
    session.execute(update(DeletedRow).where(DeletedRow.number == row.number).values(data=data))


def count(session: ReadSession, collection: CollectionNumber, since: datetime) -> int:
    """The number of shapes that were deleted from a collection since a time."""
    query = select(func.count()).select_from(DeletedRow).where(*_since(collection, since))
    return session.scalar(query) or 0


def page(
    session: ReadSession, collection: CollectionNumber, since: datetime, *, after: int, limit: int
) -> list[DeletedRecord]:
    """The next `limit` shapes that were deleted from a collection since a time, by number."""
    query = (
        select(DeletedRow)
        .where(*_since(collection, since), DeletedRow.number > after)
        .order_by(DeletedRow.number)
        .limit(limit)
    )
    return [_record(row) for row in session.scalars(query)]


def by_id(
    session: ReadSession, collection: CollectionNumber, shape_id: str, since: datetime
) -> DeletedRecord | None:
    """The shape with an id, if it was deleted from a collection since a time."""
    row = session.scalar(select(DeletedRow).where(DeletedRow.id == shape_id, *_since(collection, since)))
    return None if row is None else _record(row)


def data_of(session: ReadSession, number: int) -> bytes | None:
    """The bytes of a deleted shape's file.

    Raises
    ------
    BadRecordError
        The bytes are damaged.
    """
    own = DeletedRow.number == number
    row = session.execute(select(DeletedRow.data, DeletedRow.sha256).where(own)).one_or_none()
    return None if row is None else whole_file(row.data, row.sha256)


def remove(session: WriteSession, number: int) -> bool:
    """Erase a deleted shape; whether it existed."""
    gone = session.execute(delete(DeletedRow).where(DeletedRow.number == number).returning(DeletedRow.number))
    return gone.first() is not None


def remove_until(session: WriteSession, moment: datetime) -> None:
    """Erase the shapes that were deleted at a time or before."""
    session.execute(delete(DeletedRow).where(DeletedRow.deleted_at <= moment))


def any_until(session: ReadSession, moment: datetime) -> bool:
    """Whether a shape was deleted at a time or before."""
    query = select(DeletedRow.number).where(DeletedRow.deleted_at <= moment).limit(1)
    return session.scalar(query) is not None


def _since(collection: CollectionNumber, since: datetime) -> tuple[ColumnElement[bool], ...]:
    return DeletedRow.collection_number == collection, DeletedRow.deleted_at > since


def _record(row: DeletedRow) -> DeletedRecord:
    return DeletedRecord(
        number=row.number,
        id=row.id,
        name=row.name,
        tags=tuple(row.tags),
        metadata=row.meta,
        format=row.format,
        size=row.size,
        sha256=row.sha256,
        created_at=row.created_at,
        deleted_at=row.deleted_at,
    )
