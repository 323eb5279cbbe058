"""The database, and its two kinds of session: one reads, one writes and commits at its end."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

from sqlalchemy import Connection, Engine, insert, make_url, select
from sqlalchemy.orm import Session

from service.errors import StorageFullError, StorageUnavailableError
from service.observability.metrics import Metrics
from service.storage.failures import translated
from service.storage.hnsw_parameters import HnswParameters
from service.storage.lock import ArchiveLock
from service.storage.postgresql import open_postgresql
from service.storage.sqlite import WRITES, open_sqlite, path_of, without_references
from service.storage.tables import ArchiveRow, Table


class ReadSession(Session):
    """One view of the database, rolled back at its end."""


class WriteSession(ReadSession):
    """One transaction, committed at its end. Only one is open at a time.

    `graph` is how graphs of signatures are made. `revision` is that of the archive after it, once something
    that is searched has changed.
    """

    def __init__(self, engine: Engine, graph: HnswParameters) -> None:
        super().__init__(engine)
        self.graph = graph
        self.revision: int | None = None

    def insert(self, table: type[Table], row: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """Write a row; its primary key's first number. Several times as fast as an object that is added."""
        into = Table.metadata.tables[table.__tablename__]
        key = self.connection().execute(insert(into), row).inserted_primary_key
        assert key is not None
        return key[0]


class Database:
    """The database at one address.

    Parameters
    ----------
    url : str
        An SQLAlchemy URL of an SQLite file, or of a PostgreSQL database.
    lock_seconds : float
        The longest wait for another writer, in this process or another.
    metrics : Metrics, optional
        Where sessions and failures are counted.
    graph : GraphParameters
        Of the graphs of signatures, which PostgreSQL keeps.
    """

    def __init__(
        self,
        url: str,
        *,
        lock_seconds: float,
        metrics: Metrics | None = None,
        graph: HnswParameters = HnswParameters(),  # noqa: B008 - it is frozen
    ) -> None:
        self._metrics = metrics or Metrics()
        self._graph = graph
        self._lock_seconds = lock_seconds
        self._one_writer = threading.Lock()
        named = make_url(url)
        self._lock: ArchiveLock | None
        if named.get_backend_name() == "sqlite":
            self._engine = open_sqlite(named, lock_seconds=lock_seconds)
            self._lock = ArchiveLock(path_of(url))
            self._writing_engine = self._engine.execution_options(**{WRITES: True})
        else:
            self._engine = open_postgresql(named, lock_seconds=lock_seconds)
            self._lock = None
            self._writing_engine = self._engine.execution_options(
                **{WRITES: True, "isolation_level": "READ COMMITTED"}
            )

    @contextmanager
    def read(self) -> Iterator[ReadSession]:
        """A session that reads."""
        with self._measured("read"), translated(), ReadSession(self._engine) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[WriteSession]:
        """A session that is committed when the block ends well, and rolled back when it raises."""
        with (
            self._measured("write"),
            self._turn(),
            translated(),
            WriteSession(self._writing_engine, self._graph) as session,
            session.begin(),
        ):
            yield session

    @contextmanager
    def connect(self) -> Iterator[Connection]:
        """A bare connection in one writing transaction, for migrations. SQLite enforces no references."""
        with self._turn(), translated(), self._writing_engine.connect() as connection:
            unchecked = nullcontext() if self._lock is None else without_references(connection)
            with unchecked, connection.begin():
                yield connection

    def ping(self) -> None:
        """Ask the database for something.

        Raises
        ------
        StorageUnavailableError
            It does not answer.
        """
        with self.read() as session:
            session.scalars(select(ArchiveRow.revision)).one()

    def close(self) -> None:
        """Close every connection, and let others put another archive in the place of this one."""
        self._engine.dispose()
        if self._lock is not None:
            self._lock.release()

    @contextmanager
    def _measured(self, session: str) -> Iterator[None]:
        """Count the session, from its wait for other writers on, and how it failed."""
        metrics = self._metrics
        with metrics.database_sessions.track_inprogress(), metrics.database_seconds.labels(session).time():
            try:
                yield
            except (StorageFullError, StorageUnavailableError) as error:
                metrics.database_failures.labels(error.kind).inc()
                raise

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Wait here for this process's other writers: fair, and cheaper than asking the database."""
        if not self._one_writer.acquire(timeout=self._lock_seconds):
            raise StorageUnavailableError("the database is busy with other writes")
        try:
            yield
        finally:
            self._one_writer.release()
