"""What the database's drivers raise, said in the service's own errors."""

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
    """Raise `StorageFullError` or `StorageUnavailableError` where the database failed.

    A broken constraint is the service's own mistake and stays what it is.
    """
    try:
        yield
    except IntegrityError:
        raise
    except (DatabaseError, InterfaceError) as error:
        connected = error.statement is not None
        # A statement may be long, and the values in it are not the log's business.
        error.statement = None
        _leave_out_details(error)
        # Where there is no connection to begin with, no line of the program is at fault.
        log.error("the database failed", exc_info=error if connected else None)
        if _is_full(error.orig):
            raise StorageFullError("the disk, or the room the database may use, is full") from error
        raise StorageUnavailableError(f"the database failed: {_reason(error.orig)}") from error
    except NoConnectionError as error:
        raise StorageUnavailableError("every connection to the database is in use") from error


def _leave_out_details(error: DBAPIError) -> None:
    """Keep the first line of what PostgreSQL says: those below it may repeat the statement and its values."""
    said = getattr(getattr(error.orig, "diag", None), "message_primary", None)
    if said is not None and error.orig is not None:
        error.args = error.orig.args = (said,)


def _is_full(error: BaseException | None) -> bool:
    if isinstance(error, sqlite3.Error):
        return _code(error) == sqlite3.SQLITE_FULL
    return getattr(error, "sqlstate", None) == POSTGRESQL_DISK_FULL


def _reason(error: BaseException | None) -> str:
    """The driver's name for what happened; its message may hold paths, not the client's business."""
    return (
        error.sqlite_errorname if isinstance(error, sqlite3.Error) and _code(error) else type(error).__name__
    )


def _code(error: sqlite3.Error) -> int | None:
    return getattr(error, "sqlite_errorcode", None)
