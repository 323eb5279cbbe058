"""Operations on collections: find, list, create and delete."""

from collections.abc import Collection as Several
from datetime import UTC, datetime, timedelta

from service.collection import DEFAULT_COLLECTION, CollectionRecord, Counted, is_name
from service.collections import repository
from service.errors import BadRequestFieldsError, CollectionNotEmptyError, CollectionNotFoundError, FieldFault
from service.storage.database import ReadSession, WriteSession


def get(session: ReadSession, name: str) -> CollectionRecord:
    """Return the collection with a name.

    Raises
    ------
    CollectionNotFoundError
        No collection has the name.
    """
    collection = repository.by_name(session, name) if is_name(name) else None
    if collection is None:
        raise CollectionNotFoundError(f"there is no collection {name!r}; PUT /collections/{{name}} makes one")
    return collection


def counted(session: ReadSession, limits: Several[str] | None) -> list[Counted]:
    """Return all collections, or those with some names, sorted by name, with their numbers of shapes."""
    return repository.counted(session, limits)


def create(session: WriteSession, name: str) -> bool:
    """Create a collection unless it exists; whether it was created.

    Raises
    ------
    BadRequestFieldsError
        The name is not valid.
    """
    if not is_name(name):
        raise BadRequestFieldsError(
            FieldFault("name", "1 to 64 of a-z, 0-9, _ and -, beginning with a letter or digit")
        )
    if repository.by_name(session, name) is not None:
        return False
    repository.add(session, name)
    return True


def delete(session: WriteSession, name: str, keep: timedelta) -> None:
    """Delete an empty collection and the records of its jobs. Deleted shapes can be restored for `keep`.

    Raises
    ------
    CollectionNotFoundError
    CollectionNotEmptyError
        It is the default one, or has shapes, deleted shapes that can be restored, or an unfinished job.
    """
    collection = get(session, name)
    if collection.number == DEFAULT_COLLECTION.number:
        raise CollectionNotEmptyError(f"the collection {name!r} cannot be deleted")
    if repository.holds_shapes(session, collection.number):
        raise CollectionNotEmptyError(f"the collection {name!r} has shapes")
    if repository.deleted_until(session, collection.number, datetime.now(UTC) - keep):
        raise CollectionNotEmptyError(
            f"shapes that were deleted from the collection {name!r} can still be restored: purge them first"
        )
    if repository.has_open_job(session, collection.number):
        raise CollectionNotEmptyError(f"a job of the collection {name!r} has not ended")
    repository.remove(session, collection.number)
