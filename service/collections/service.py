"""What can be done with collections."""

from collections.abc import Collection as Several
from datetime import UTC, datetime, timedelta

from service.collection import DEFAULT_COLLECTION, Collection, Counted, is_name
from service.collections import repository
from service.errors import BadRequestFieldsError, CollectionNotEmptyError, CollectionNotFoundError, FieldFault
from service.storage.database import ReadSession, WriteSession


def get(session: ReadSession, name: str) -> Collection:
    """The collection of a name.

    Raises
    ------
    CollectionNotFoundError
        There is none.
    """
    found = repository.by_name(session, name) if is_name(name) else None
    if found is None:
        raise CollectionNotFoundError(f"there is no collection {name!r}; PUT /collections/{{name}} makes one")
    return found


def counted(session: ReadSession, limits: Several[str] | None) -> list[Counted]:
    """The collections by name, those of some names or all, and how many shapes each has."""
    return repository.counted(session, limits)


def create(session: WriteSession, name: str) -> bool:
    """Make a collection, unless it is there; whether it was made.

    Raises
    ------
    BadRequestFieldsError
        No collection may be called so.
    """
    if not is_name(name):
        raise BadRequestFieldsError(
            FieldFault("name", "1 to 64 of a-z, 0-9, _ and -, of which the first is no _ and no -")
        )
    if repository.by_name(session, name) is not None:
        return False
    repository.add(session, name)
    return True


def delete(session: WriteSession, name: str, keep: timedelta) -> None:
    """Delete a collection that is empty, and the records of its jobs. What was deleted is kept for so long.

    Raises
    ------
    CollectionNotFoundError
    CollectionNotEmptyError
        It is the default one, or has shapes, deleted ones that can be restored, or a job that has not ended.
    """
    collection = get(session, name)
    if collection.number == DEFAULT_COLLECTION.number:
        raise CollectionNotEmptyError(f"the collection {name!r} is always there")
    if repository.holds_shapes(session, collection.number):
        raise CollectionNotEmptyError(f"the collection {name!r} has shapes")
    if repository.deleted_until(session, collection.number, datetime.now(UTC) - keep):
        raise CollectionNotEmptyError(
            f"shapes that were deleted from the collection {name!r} can still be restored: purge them first"
        )
    if repository.is_at_work(session, collection.number):
        raise CollectionNotEmptyError(f"a job of the collection {name!r} has not ended")
    repository.remove(session, collection.number)
