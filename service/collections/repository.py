"""The SQL of collections."""

from collections.abc import Collection as Several
from datetime import UTC, datetime

from sqlalchemy import delete, func, insert, select

from service.collection import CollectionNumber, CollectionRecord, Counted
from service.errors import CollectionNotFoundError
from service.storage.database import ReadSession, WriteSession
from service.storage.erasure import erase
from service.storage.tables import NOT_DELETED, CollectionRow, JobRow, ShapeRow


def by_name(session: ReadSession, name: str) -> CollectionRecord | None:
    """Return the collection with a name."""
    number = session.scalar(select(CollectionRow.number).where(CollectionRow.name == name))
    return None if number is None else CollectionRecord(CollectionNumber(number), name)


def require(session: WriteSession, collection: CollectionNumber) -> None:
    """Raise unless a collection exists. Until the end of the session no other one can delete it.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    """
    query = select(CollectionRow.number).where(CollectionRow.number == collection)
    if session.scalar(query) is None:
        raise CollectionNotFoundError("the collection was deleted meanwhile")


def counted(session: ReadSession, names: Several[str] | None) -> list[Counted]:
    """Return all collections, or those with some names, sorted by name, with their numbers of shapes."""
    shapes = (
        select(func.count())
        .select_from(ShapeRow)
        .where(ShapeRow.collection_number == CollectionRow.number, NOT_DELETED)
        .scalar_subquery()
    )
    query = select(CollectionRow.name, CollectionRow.created_at, shapes).order_by(CollectionRow.name)
    if names is not None:
        query = query.where(CollectionRow.name.in_(names))
    return [Counted(name, created_at, many or 0) for name, created_at, many in session.execute(query)]


def add(session: WriteSession, name: str) -> None:
    """Create a collection."""
    session.execute(insert(CollectionRow).values(name=name, created_at=datetime.now(UTC)))


def holds_shapes(session: ReadSession, collection: CollectionNumber) -> bool:
    """Return whether a collection has a shape."""
    query = select(ShapeRow.number).where(ShapeRow.collection_number == collection, NOT_DELETED).limit(1)
    return session.scalar(query) is not None


def deleted_until(session: WriteSession, collection: CollectionNumber, moment: datetime) -> bool:
    """Erase the shapes that were deleted from a collection until a time; return whether later ones remain."""
    inside = ShapeRow.collection_number == collection
    erase(session, inside & (ShapeRow.deleted_at <= moment))
    return session.scalar(select(ShapeRow.number).where(inside, ~NOT_DELETED).limit(1)) is not None


def remove(session: WriteSession, collection: CollectionNumber) -> None:
    """Delete an empty collection and the records of its jobs."""
    session.execute(delete(JobRow).where(JobRow.collection_number == collection))
    session.execute(delete(CollectionRow).where(CollectionRow.number == collection))


def has_open_job(session: ReadSession, collection: CollectionNumber) -> bool:
    """Return whether a collection has an unfinished job."""
    query = select(JobRow.number).where(JobRow.collection_number == collection, JobRow.ended_at.is_(None))
    return session.scalar(query.limit(1)) is not None
