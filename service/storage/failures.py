"""Translation of database driver errors into errors of the service."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import DatabaseError, DBAPIError, IntegrityError, InterfaceError
from sqlalchemy.exc import TimeoutError as NoConnectionError

from service.errors import StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger

log = get_logger("storage")

POSTGRESQL_DISK_FULL = "53100"


@contextmanager
def translated() -> Iterator[None]:
    """Raise `StorageFullError` or `StorageUnavailableError` for errors of the database.

    A violated constraint is an error of the program and passes unchanged.
    """
    try:
        yield
    except IntegrityError:
        raise
    except (DatabaseError, InterfaceError) as error:
        connected = error.statement is not None
        # Statements may be long, and their values must not appear in the log.
        error.statement = None
        _remove_details(error)
        # A failed connection attempt needs no traceback.
        log.error("the database failed", exc_info=error if connected else None)
        if _is_full(error.orig):
            raise StorageFullError("the disk, or the room the database may use, is full") from error
        raise StorageUnavailableError(f"the database failed: {_reason(error.orig)}") from error
    except NoConnectionError as error:
        raise StorageUnavailableError("every connection to the database is in use") from error


def _remove_details(error: DBAPIError) -> None:
    """Keep only the primary message of PostgreSQL: the details may repeat the statement and its values."""
    message = getattr(getattr(error.orig, "diag", None), "message_primary", None)
    if message is not None and error.orig is not None:
        error.args = error.orig.args = (message,)


def _is_full(error: BaseException | None) -> bool:
    if isinstance(error, sqlite3.Error):
        return _code(error) == sqlite3.SQLITE_FULL
    return getattr(error, "sqlstate", None) == POSTGRESQL_DISK_FULL


def _reason(error: BaseException | None) -> str:
    """The driver's name of the error; its message may contain paths, which clients must not see."""
    return (
        error.sqlite_errorname if isinstance(error, sqlite3.Error) and _code(error) else type(error).__name__
    )


def _code(error: sqlite3.Error) -> int | None:
    return getattr(error, "sqlite_errorcode", None)
