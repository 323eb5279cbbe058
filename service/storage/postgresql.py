"""PostgreSQL: its engines, the requirements on the server, and HNSW indexes (Malkov and Yashunin 2018).

pgvector builds the indexes. Each pipeline has its own index of signatures, because the length of a signature
depends on the pipeline. PostgreSQL updates the indexes with every write.
"""

import math
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import Any
from weakref import WeakSet

from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Index,
    MetaData,
    cast,
    create_engine,
    event,
    func,
    literal,
    select,
    text,
)
from sqlalchemy.engine import URL
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.errors import ArchiveError
from service.observability.logging import get_logger
from service.storage.columns import POSTGRESQL, PgVector
from service.storage.sqlite import WRITES
from service.storage.tables import CoarseSamplesRow, EmbeddingRow, Table

log = get_logger("storage")

DRIVER = "postgresql+psycopg"

# An arbitrary number; all writers of an archive use the same.
WRITERS_LOCK = 0x1505_4A9E

CONNECTIONS = 8
MORE_CONNECTIONS = 24

# Without a time limit, a connection to a machine that has failed never ends.
CONNECT_SECONDS = 5
SILENCE_SECONDS = 10

# The age of a session from which the server must take a new connection, and the time between two looks.
LONG_SECONDS = 4.0
LOOK_SECONDS = 1.0


def open_postgresql(url: URL, *, lock_seconds: float) -> Engine:
    """Return an engine on a PostgreSQL database.

    A read session sees the database as of its first statement (REPEATABLE READ). A connection with the
    execution option `WRITES` begins its transactions with an advisory lock that all writers take, like
    SQLite's BEGIN IMMEDIATE: it sees the results of every earlier transaction (READ COMMITTED), and numbers
    and revisions become visible in the order of their creation. The pool replaces connections that the server
    has closed.

    Raise ArchiveError if the driver is not installed.
    """
    if find_spec("psycopg") is None:
        raise ArchiveError("PostgreSQL needs a driver: pip install 'isoshape[postgres]'")
    milliseconds = max(1, math.ceil(1e3 * lock_seconds))
    options = url.query.get("options", "")
    wanted: dict[str, object] = {
        "application_name": "isoshape",
        "connect_timeout": CONNECT_SECONDS,
        "keepalives_idle": SILENCE_SECONDS,
        "keepalives_interval": SILENCE_SECONDS // 5,
        "keepalives_count": 5,
        "tcp_user_timeout": 1000 * SILENCE_SECONDS,
    }
    engine = create_engine(
        url.set(drivername=DRIVER),
        connect_args={
            **{name: value for name, value in wanted.items() if name not in url.query},
            "client_encoding": "utf8",
            "options": f"{options} -c lock_timeout={milliseconds}".strip(),
        },
        isolation_level="REPEATABLE READ",
        pool_size=CONNECTIONS,
        max_overflow=MORE_CONNECTIONS,
        pool_timeout=lock_seconds,
        pool_pre_ping=True,
        hide_parameters=True,
    )
    event.listen(engine, "begin", _begin)
    return engine


class StillServerWatch:
    """Ends the sessions of a server that stands still.

    The system notices a machine that fails, but not a server that is stopped: it holds its connections and
    answers none. While a session takes longer than `LONG_SECONDS`, a thread tries a new connection every
    `LOOK_SECONDS`. If none is made within `CONNECT_SECONDS`, the thread shuts down all connections, and their
    sessions fail.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connections: WeakSet[Any] = WeakSet()
        self._begun: dict[object, float] = {}
        self._closed = threading.Event()
        event.listen(engine, "connect", lambda connection, _record: self._connections.add(connection))
        threading.Thread(target=self._look, daemon=True, name="isoshape-postgresql").start()

    @contextmanager
    def session(self) -> Iterator[None]:
        """Watch a session, from before its connection to its end."""
        key = object()
        self._begun[key] = time.monotonic()
        try:
            yield
        finally:
            del self._begun[key]

    def close(self) -> None:
        """End the thread."""
        self._closed.set()

    def _look(self) -> None:
        while not self._closed.wait(LOOK_SECONDS):
            try:
                oldest = min(list(self._begun.values()), default=math.inf)
                if time.monotonic() > oldest + LONG_SECONDS and not self._answers():
                    log.error("the database stands still: its sessions are ended")
                    for connection in list(self._connections):
                        _shut_down(connection)
            except Exception as error:
                # Other threads make connections meanwhile; the next look comes soon.
                log.warning("it is unknown whether the database stands still", exc_info=error)

    def _answers(self) -> bool:
        """Return whether the server takes a new connection, or refuses it with a reason."""
        arguments, keywords = self._engine.dialect.create_connect_args(self._engine.url)
        dbapi = self._engine.dialect.import_dbapi()
        try:
            dbapi.connect(*arguments, **{**keywords, "connect_timeout": CONNECT_SECONDS}).close()
        except dbapi.OperationalError as error:
            return not isinstance(error, dbapi.errors.ConnectionTimeout)
        return True


def _shut_down(connection: Any) -> None:  # noqa: ANN401
    """Have the reads and writes of a connection fail, in whatever thread they wait."""
    with suppress(Exception), socket.socket(fileno=os.dup(connection.pgconn.socket)) as copy:
        copy.shutdown(socket.SHUT_RDWR)


def check_server(connection: Connection) -> None:
    """Raise unless the server meets the requirements of an archive.

    Raise ArchiveError if the database is not in UTF-8, or the server has no pgvector.
    """
    encoding = connection.execute(text("SHOW server_encoding")).scalar_one()
    if encoding != "UTF8":
        raise ArchiveError(f"the database is encoded in {encoding}, and an archive needs UTF8")
    offered = text("SELECT count(*) FROM pg_available_extensions WHERE name = 'vector'")
    if not connection.execute(offered).scalar_one():
        raise ArchiveError("the PostgreSQL server has no pgvector (https://github.com/pgvector/pgvector)")


M = 16
"""Neighbours of a signature in each layer, twice as many in the lowest; 2 to 100."""
EF_CONSTRUCTION = 200
"""Size of the candidate list while an index is built; 2 m to 1,000."""
EF_SEARCH = 400
"""Size of the candidate list while an index is searched; 1 to 1,000."""


def index_name(fingerprint: str) -> str:
    """Return the name of a pipeline's HNSW index."""
    return f"signatures_{fingerprint}"


def has_view_signature(length: int) -> ColumnElement[bool]:
    """Return the condition that an embedding has a view signature of a length."""
    return func.vector_dims(CoarseSamplesRow.view_signature) == literal(length, literal_execute=True)


def ensure_hnsw(
    session: Session, fingerprint: str, *, m: int = M, ef_construction: int = EF_CONSTRUCTION
) -> bool:
    """Build a pipeline's HNSW indexes unless they exist with these parameters; return whether one was built.

    One is of its signatures. The other is of the view signatures of all pipelines that have views of one
    length. The lengths of the vectors come from stored ones: without any, and on SQLite, no index is built.
    Other writers wait until the indexes are complete.
    """
    if session.get_bind().dialect.name != POSTGRESQL:
        return False
    parameters = {"m": m, "ef_construction": ef_construction}
    by_pipeline = EmbeddingRow.fingerprint == fingerprint
    length = session.scalar(select(func.vector_dims(EmbeddingRow.signature)).where(by_pipeline).limit(1))
    if length is None:
        return False
    name, column = index_name(fingerprint), EmbeddingRow.signature
    built = _ensure(session, name, column, "vector_l2_ops", length, by_pipeline, parameters)
    views = CoarseSamplesRow.view_signature
    lengths = select(func.vector_dims(views)).join(
        EmbeddingRow, EmbeddingRow.number == CoarseSamplesRow.embedding_number
    )
    length = session.scalar(lengths.where(by_pipeline).limit(1))
    if length is None:
        return built
    name, condition = f"view_signatures_{length}", has_view_signature(length)
    return _ensure(session, name, views, "vector_l1_ops", length, condition, parameters) or built


def _ensure(
    session: Session,
    name: str,
    column: InstrumentedAttribute[Any],
    operators: str,
    length: int,
    condition: ColumnElement[bool],
    parameters: dict[str, int],
) -> bool:
    connection = session.connection()
    built_with = connection.execute(
        text("SELECT reloptions FROM pg_class WHERE relname = :name AND relkind = 'i'"), {"name": name}
    ).scalar()
    if built_with == [f"{parameter}={value}" for parameter, value in parameters.items()]:
        return False
    log.info("building an HNSW index", extra={"fields": {"name": name}})
    # A copy of the table definition: the index of one archive must not join the metadata of all archives.
    table = Table.metadata.tables[column.class_.__tablename__].to_metadata(MetaData())
    index = Index(
        name,
        cast(table.c[column.key], PgVector(length)).label("vector"),
        postgresql_using="hnsw",
        postgresql_ops={"vector": operators},
        postgresql_with=parameters,
        postgresql_where=condition,
    )
    index.drop(connection, checkfirst=True)
    index.create(connection)
    return True


def _begin(connection: Connection) -> None:
    if connection.get_execution_options().get(WRITES, False):
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITERS_LOCK})")
