"""The database and its two kinds of session: read sessions, and write sessions that commit at their end.

A new database gets its tables here, and the archive of an older version its migrations.
"""

import sqlite3
import threading
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, nullcontext
from contextvars import ContextVar
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from anyio import to_thread
from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Select,
    delete,
    insert,
    make_url,
    select,
    text,
    update,
)
from sqlalchemy.exc import DatabaseError, DBAPIError, IntegrityError, InterfaceError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.collection import DEFAULT_COLLECTION
from service.errors import ArchiveTooNewError, StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger
from service.observability.metrics import Metrics
from service.storage.columns import POSTGRESQL
from service.storage.postgresql import StillServerWatch, check_server, open_postgresql
from service.storage.sqlite import WRITES, ArchiveLock, DatabaseFile, open_sqlite, path_of, without_references
from service.storage.tables import (
    ArchiveRow,
    BlobRow,
    CollectionRow,
    EmbeddingRow,
    ShapeRow,
    ShapeWordRow,
    Table,
    WordRow,
)
from service.turns import Turns

log = get_logger("storage")

POSTGRESQL_DISK_FULL = "53100"

THREADS = 2
"""The most threads at a time that read or write for light requests; more would wait for each other."""

AT_ONCE = 10_000
"""Words or files that one statement erases: PostgreSQL takes no more than 65,535 values."""

_has_turn: ContextVar[bool] = ContextVar("has_turn", default=False)

T = TypeVar("T")
P = ParamSpec("P")


class ReadSession(Session):
    """A session that reads from one snapshot of the database. It is rolled back at its end."""


class WriteSession(ReadSession):
    """A session of one transaction, committed at its end. Only one write session is open at a time.

    `revision` is that of the archive after the transaction; None until the transaction changes searchable
    data.
    """

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, expire_on_commit=False)
        self.revision: int | None = None

    def insert(self, table: type[Table], row: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """Insert a row and return the first column of its primary key; several times as fast as `add`."""
        into = Table.metadata.tables[table.__tablename__]
        key = self.connection().execute(insert(into), row).inserted_primary_key
        assert key is not None
        return key[0]


def next_revision(session: WriteSession) -> int:
    """Increase the revision, once per transaction: nobody sees a part of one."""
    if session.revision is None:
        counted = update(ArchiveRow).values(revision=ArchiveRow.revision + 1).returning(ArchiveRow.revision)
        session.revision = session.scalars(counted).one()
    return session.revision


class Database:
    """The database at an SQLAlchemy URL, an SQLite file or a PostgreSQL database.

    `lock_seconds` is the longest wait for another writer, in this process or another. `metrics` count
    sessions and failures. With `reserve` the disk keeps room for deletions; SQLite only.
    """

    def __init__(
        self, url: str, *, lock_seconds: float, metrics: Metrics | None = None, reserve: bool = False
    ) -> None:
        self._metrics = metrics or Metrics()
        self._lock_seconds = lock_seconds
        self._one_writer = threading.Lock()
        self._turns = Turns(THREADS, kept_seconds=1.0)
        named = make_url(url)
        self._lock: ArchiveLock | None
        self._file: DatabaseFile | None
        self._watch: StillServerWatch | None = None
        if named.get_backend_name() == "sqlite":
            self._engine = open_sqlite(named, lock_seconds=lock_seconds)
            self._lock = ArchiveLock(path_of(url))
            self._file = DatabaseFile(path_of(url), keeps_reserve=reserve)
            self._writing_engine = self._engine.execution_options(**{WRITES: True})
        else:
            self._engine = open_postgresql(named, lock_seconds=lock_seconds)
            self._watch = StillServerWatch(self._engine)
            self._lock = None
            self._file = None
            self._writing_engine = self._engine.execution_options(
                **{WRITES: True, "isolation_level": "READ COMMITTED"}
            )

    @contextmanager
    def read(self) -> Iterator[ReadSession]:
        """Open a read session. Its transaction begins before the block."""
        with self._measured("read"), translated(), ReadSession(self._engine) as session:
            session.connection()
            yield session

    @contextmanager
    def write(self, *, deleting: bool = False) -> Iterator[WriteSession]:
        """Open a write session: committed at the end of the block, rolled back if the block raises.

        `deleting`: the block deletes only, and may use the reserve of a full disk.
        """
        with (
            self._measured("write"),
            self._turn(),
            self._writable_file(deleting),
            translated(),
            WriteSession(self._writing_engine) as session,
            session.begin(),
        ):
            yield session

    async def reading(
        self, function: Callable[Concatenate[ReadSession, P], T], *values: P.args, **named: P.kwargs
    ) -> T:
        """Call a function with a read session and further values, in a thread; return its result."""

        def call() -> T:
            with self.read() as session:
                return function(session, *values, **named)

        return await self.in_thread(call)

    async def writing(
        self, function: Callable[Concatenate[WriteSession, P], T], *values: P.args, **named: P.kwargs
    ) -> T:
        """Call a function with a write session and further values, in a thread; return its result."""

        def call() -> T:
            with self.write() as session:
                return function(session, *values, **named)

        return await self.in_thread(call)

    async def in_thread(self, function: Callable[[], T]) -> T:
        """Call a function, which opens sessions itself, in a thread; return its result."""
        async with self.turn():
            return await to_thread.run_sync(function)

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for the turn of the client at the threads that use the database, unless this task has it."""
        if _has_turn.get():
            yield
            return
        async with self._turns.turn():
            token = _has_turn.set(True)
            try:
                yield
            finally:
                _has_turn.reset(token)

    @contextmanager
    def connect(self) -> Iterator[Connection]:
        """Open a connection in one write transaction, for migrations; SQLite checks no foreign keys in it."""
        with self._turn(), translated(), self._writing_engine.connect() as connection:
            unchecked = nullcontext() if self._lock is None else without_references(connection)
            with unchecked, connection.begin():
                yield connection

    def ping(self) -> None:
        """Read one row of the database; raise StorageUnavailableError if the database does not answer."""
        if self._file is not None:
            self._file.check()
        with self.read() as session:
            session.scalars(select(ArchiveRow.revision)).one()

    def close(self) -> None:
        """Close every connection and release the lock of the archive."""
        self._engine.dispose()
        if self._watch is not None:
            self._watch.close()
        if self._lock is not None:
            self._lock.release()

    @contextmanager
    def _measured(self, session: str) -> Iterator[None]:
        """Measure a session, its wait for other writers included, and count its failure."""
        metrics = self._metrics
        with metrics.database_sessions.track_inprogress(), metrics.database_seconds.labels(session).time():
            try:
                with nullcontext() if self._watch is None else self._watch.session():
                    yield
            except (StorageFullError, StorageUnavailableError) as error:
                metrics.database_failures.labels(error.kind).inc()
                raise

    @contextmanager
    def _writable_file(self, deleting: bool) -> Iterator[None]:
        """Check the file of SQLite before a write session, and keep or lend its reserve."""
        if self._file is None:
            yield
            return
        self._file.check(writable=True)
        if deleting:
            with self._file.room_to_delete():
                yield
            return
        yield
        self._file.keep_reserve()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Wait for other writers of this process; fairer and cheaper than waiting in the database."""
        if not self._one_writer.acquire(timeout=self._lock_seconds):
            raise StorageUnavailableError("the database is busy with other writes")
        try:
            yield
        finally:
            self._one_writer.release()


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
    full_sqlite = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
    return full_sqlite or getattr(error, "sqlstate", None) == POSTGRESQL_DISK_FULL


def _reason(error: BaseException | None) -> str:
    """Return the driver's name of the error; its message may contain paths, which clients must not see."""
    return getattr(error, "sqlite_errorname", None) or type(error).__name__


def erase(session: WriteSession, condition: ColumnElement[bool]) -> None:
    """Erase the shapes that satisfy a condition, and the files that no other shape has."""
    blobs = set(session.scalars(select(ShapeRow.blob_number).where(condition)))
    erased = ShapeWordRow.shape_number.in_(select(ShapeRow.number).where(condition))
    words = set(session.scalars(select(ShapeWordRow.word_number).where(erased)))
    session.execute(delete(ShapeRow).where(condition))
    drop_unused(session, blobs)
    drop_unused_words(session, words)


def drop_unused(session: WriteSession, blobs: Collection[int]) -> None:
    """Erase those of some files that no shape has, and their embeddings in formats that no shape has.

    A deleted shape has its file until it is erased.
    """
    in_format = select(ShapeRow.number).where(
        ShapeRow.blob_number == EmbeddingRow.blob_number, ShapeRow.format == EmbeddingRow.format
    )
    _drop(session, EmbeddingRow, EmbeddingRow.blob_number, blobs, in_format)
    used = select(ShapeRow.number).where(ShapeRow.blob_number == BlobRow.number)
    _drop(session, BlobRow, BlobRow.number, blobs, used)


def drop_unused_words(session: WriteSession, words: Collection[int]) -> None:
    """Erase those of some words that no shape has, deleted or not."""
    used = select(ShapeWordRow.word_number).where(ShapeWordRow.word_number == WordRow.number)
    _drop(session, WordRow, WordRow.number, words, used)


def _drop(
    session: WriteSession,
    table: type[Table],
    column: InstrumentedAttribute[int],
    numbers: Collection[int],
    used: Select[int],
) -> None:
    """Erase the rows of a table with some numbers in a column that a query finds no use of."""
    ordered = sorted(numbers)
    for start in range(0, len(ordered), AT_ONCE):
        unused = column.in_(ordered[start : start + AT_ONCE]), ~used.exists()
        session.execute(delete(table).where(*unused), execution_options={"synchronize_session": False})


_FOLDER = Path(__file__).parent / "migrations"


def migrate(database: Database) -> None:
    """Create the tables of an empty database, or run all missing migrations, in one transaction.

    Raise ArchiveError if a newer version of the service wrote the database, or the database server does not
    meet the requirements of an archive.
    """
    config = _config()
    with database.connect() as connection:
        if connection.dialect.name == POSTGRESQL:
            check_server(connection)
        versions = MigrationContext.configure(connection).get_current_heads()
        check_known(versions)
        config.attributes["connection"] = connection
        if versions:
            command.upgrade(config, "head")
        else:
            _create(connection)
            command.stamp(config, "head")


def _create(connection: Connection) -> None:
    """Create the tables, and insert the rows that every archive has."""
    if connection.dialect.name == POSTGRESQL:
        connection.execute(text("CREATE EXTENSION IF NOT EXISTS vector"))
    Table.metadata.create_all(connection, checkfirst=False)
    if connection.dialect.name == POSTGRESQL:
        # Its samples have few of the rare words, so that it would take each word for a frequent one and read
        # all rows: 100,000 names as makers write them have one word in 30 rows.
        connection.execute(text("ALTER TABLE shape_words ALTER word_number SET (n_distinct = -0.03)"))
    connection.execute(insert(ArchiveRow).values(number=1, revision=0))
    # The database generates the number, so that it never gives the number again.
    connection.execute(
        insert(CollectionRow).values(name=DEFAULT_COLLECTION.name, created_at=datetime.now(UTC))
    )


def check_known(versions: Iterable[str]) -> None:
    """Raise ArchiveTooNewError unless this code knows all versions that a database has."""
    known = {script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()}
    unknown = sorted(set(versions) - known)
    if unknown:
        raise ArchiveTooNewError(
            f"the database has version {', '.join(unknown)}, which this Isoshape does not know: a newer one "
            f"wrote it. Use that one, or restore a backup that this one wrote."
        )


def _config() -> Config:
    config = Config()
    # Alembic expands percent signs in the value, so that they are doubled.
    config.set_main_option("script_location", str(_FOLDER).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config
