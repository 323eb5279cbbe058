"""Collections in the database: find, list, create and delete."""

from collections.abc import Collection as Several
from datetime import UTC, datetime, timedelta

from sqlalchemy import Row, delete, func, insert, select

from service.collection import DEFAULT_COLLECTION, CollectionNumber, CollectionRecord, is_name
from service.errors import BadRequestFieldsError, CollectionNotEmptyError, CollectionNotFoundError, FieldFault
from service.storage.database import ReadSession, WriteSession, erase
from service.storage.tables import NOT_DELETED, CollectionRow, JobRow, ShapeRow, SourceRow


def get(session: ReadSession, name: str) -> CollectionRecord:
    """Return the collection with a name; raise CollectionNotFoundError if no collection has the name."""
    query = select(CollectionRow.number).where(CollectionRow.name == name)
    number = session.scalar(query) if is_name(name) else None
    if number is None:
        raise CollectionNotFoundError(f"there is no collection {name!r}; PUT /collections/{{name}} makes one")
    return CollectionRecord(CollectionNumber(number), name)


def require(session: WriteSession, collection: CollectionNumber) -> None:
    """Raise CollectionNotFoundError unless a collection exists; none can delete it until the session ends."""
    query = select(CollectionRow.number).where(CollectionRow.number == collection)
    if session.scalar(query) is None:
        raise CollectionNotFoundError("the collection was deleted meanwhile")


def counted(session: ReadSession, names: Several[str] | None) -> list[Row[tuple[str, datetime, int]]]:
    """Return the `name`, `created_at` and number of `shapes` of all collections or of some, by name."""
    shapes = (
        select(func.count())
        .select_from(ShapeRow)
        .where(ShapeRow.collection_number == CollectionRow.number, NOT_DELETED)
        .scalar_subquery()
    )
    query = select(CollectionRow.name, CollectionRow.created_at, shapes.label("shapes"))
    if names is not None:
        query = query.where(CollectionRow.name.in_(names))
    return list(session.execute(query.order_by(CollectionRow.name)))


def create(session: WriteSession, name: str) -> bool:
    """Create a collection unless it exists; return whether it was created.

    Raise BadRequestFieldsError if the name is not valid.
    """
    if not is_name(name):
        raise BadRequestFieldsError(
            FieldFault("name", "1 to 64 of a-z, 0-9, _ and -, beginning with a letter or digit")
        )
    if session.scalar(select(CollectionRow.number).where(CollectionRow.name == name)) is not None:
        return False
    session.execute(insert(CollectionRow).values(name=name, created_at=datetime.now(UTC)))
    return True


def remove(session: WriteSession, name: str, keep: timedelta) -> None:
    """Delete an empty collection and the records of its jobs. Deleted shapes can be restored for `keep`.

    Raise CollectionNotFoundError, or CollectionNotEmptyError if it is the default one, or has shapes, deleted
    shapes that can be restored, a source, or an unfinished job.
    """
    collection = get(session, name)
    if collection == DEFAULT_COLLECTION:
        raise CollectionNotEmptyError(f"the collection {name!r} cannot be deleted")
    inside = ShapeRow.collection_number == collection.number
    shapes = select(ShapeRow.number).where(inside).limit(1)
    if session.scalar(shapes.where(NOT_DELETED)) is not None:
        raise CollectionNotEmptyError(f"the collection {name!r} has shapes")
    erase(session, inside & (ShapeRow.deleted_at <= datetime.now(UTC) - keep))
    if session.scalar(shapes) is not None:
        raise CollectionNotEmptyError(
            f"shapes that were deleted from the collection {name!r} can still be restored: purge them first"
        )
    of_collection = JobRow.collection_number == collection.number
    if (
        session.scalar(select(JobRow.number).where(of_collection, JobRow.ended_at.is_(None)).limit(1))
        is not None
    ):
        raise CollectionNotEmptyError(f"a job of the collection {name!r} has not ended")
    its_sources = SourceRow.collection_number == collection.number
    if session.scalar(select(SourceRow.number).where(its_sources, SourceRow.removed_at.is_(None)).limit(1)):
        raise CollectionNotEmptyError(f"the collection {name!r} has a source")
    session.execute(delete(SourceRow).where(its_sources))
    session.execute(delete(JobRow).where(of_collection))
    session.execute(delete(CollectionRow).where(CollectionRow.number == collection.number))
