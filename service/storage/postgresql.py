"""PostgreSQL engines: their options, and the requirements on the server."""

import math
from importlib.util import find_spec

from sqlalchemy import Connection, Engine, create_engine, event, text
from sqlalchemy.engine import URL

from service.errors import ArchiveError
from service.storage.sqlite import WRITES

DRIVER = "postgresql+psycopg"

# An arbitrary number; all writers of an archive use the same.
WRITERS_LOCK = 0x1505_4A9E

CONNECTIONS = 8
MORE_CONNECTIONS = 24

# Without a time limit, a connection to a machine that has failed never ends.
CONNECT_SECONDS = 5
SILENCE_SECONDS = 10


def open_postgresql(url: URL, *, lock_seconds: float) -> Engine:
    """Return an engine on a PostgreSQL database.

    A read session sees the database as of its first statement (REPEATABLE READ). A connection with the
    execution option `WRITES` begins its transactions with an advisory lock that all writers take, like
    SQLite's BEGIN IMMEDIATE: it sees the results of every earlier transaction (READ COMMITTED), and numbers
    and revisions become visible in the order of their creation. The pool replaces connections that the server
    has closed.

    Raises
    ------
    ArchiveError
        The driver is not installed.
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


def check_server(connection: Connection) -> None:
    """Raise unless the server meets the requirements of an archive.

    Raises
    ------
    ArchiveError
        The database is not in UTF-8, or the server has no pgvector.
    """
    encoding = connection.execute(text("SHOW server_encoding")).scalar_one()
    if encoding != "UTF8":
        raise ArchiveError(f"the database is encoded in {encoding}, and an archive needs UTF8")
    offered = text("SELECT count(*) FROM pg_available_extensions WHERE name = 'vector'")
    if not connection.execute(offered).scalar_one():
        raise ArchiveError("the PostgreSQL server has no pgvector (https://github.com/pgvector/pgvector)")


def _begin(connection: Connection) -> None:
    if connection.get_execution_options().get(WRITES, False):
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITERS_LOCK})")
