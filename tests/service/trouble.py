"""Faults of a database, brought about on either engine, and undone."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager

import psycopg
from sqlalchemy import Connection, event, make_url

from service.storage.database import Database
from service.storage.postgresql import WRITERS_LOCK
from service.storage.sqlite import path_of
from tests.service.engines import bare

PAGES = 1_000_000_000

_NO_ROOM = """
CREATE FUNCTION no_room() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'could not extend file: No space left on device' USING ERRCODE = 'disk_full';
END $$;
CREATE TRIGGER no_room BEFORE INSERT ON blobs FOR EACH ROW WHEN (NEW.size > 50000) EXECUTE FUNCTION no_room();
"""


def is_sqlite(url: str) -> bool:
    return make_url(url).get_backend_name() == "sqlite"


def url_of(database: Database) -> str:
    return database._engine.url.render_as_string(hide_password=False)


@contextmanager
def lock_held(url: str, *, readers_too: bool = False) -> Iterator[None]:
    """Another client is in the middle of a write, or keeps even readers away."""
    if is_sqlite(url):
        with closing(sqlite3.connect(path_of(url), isolation_level=None)) as file:
            file.execute("BEGIN EXCLUSIVE" if readers_too else "BEGIN IMMEDIATE")
            yield
            file.execute("COMMIT")
        return
    with psycopg.connect(url.replace("+psycopg", "")) as client:
        client.execute("SELECT pg_advisory_xact_lock(%s)", [WRITERS_LOCK])
        if readers_too:
            client.execute("LOCK TABLE archive, blobs, shapes, embeddings IN ACCESS EXCLUSIVE MODE")
        yield


@contextmanager
def full(database: Database) -> Iterator[None]:
    """There is room for little more: not for a blob of more than 50,000 bytes."""
    url = url_of(database)
    if is_sqlite(url):
        with bare(url) as connection:
            pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
        little, much = (f"PRAGMA max_page_count = {count}" for count in (pages + 4, PAGES))
        with in_each_transaction(database, little, much):
            yield
        return
    with bare(url) as connection:
        connection.exec_driver_sql(_NO_ROOM)
    try:
        yield
    finally:
        with bare(url) as connection:
            connection.exec_driver_sql("DROP FUNCTION no_room CASCADE")


@contextmanager
def not_writable(database: Database) -> Iterator[None]:
    """The database may be read, and not written."""
    if is_sqlite(url_of(database)):
        with in_each_transaction(database, "PRAGMA query_only = ON", "PRAGMA query_only = OFF"):
            yield
        return
    with in_each_transaction(database, "SET TRANSACTION READ ONLY", "SET TRANSACTION READ WRITE"):
        yield


@contextmanager
def in_each_transaction(database: Database, statement: str, afterwards: str) -> Iterator[None]:
    """Run a statement at the beginning of each transaction; and later another, which undoes it."""
    now = [statement]

    def run(connection: Connection) -> None:
        connection.exec_driver_sql(now[0])

    event.listen(database._engine, "begin", run)
    try:
        yield
    finally:
        now[0] = afterwards
