"""Archives made without a service, to be checked, copied and spoilt."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path

from core.io import Limits
from core.parameters import DEFAULT
from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import Embedded, embed_file
from service.pipelines.active import Pipelines, begin
from service.shapes import file_repository, repository
from service.shapes.records import NewShape
from service.storage.database import Database, migrate
from tests.service.support import small_file


@cache
def embedded(number: int) -> Embedded:
    return embed_file(small_file(number), "off", Limits(), DEFAULT)


def make_archive(path: Path, *numbers: int) -> Path:
    """An archive that holds the small files of these numbers, each under its number."""
    database = Database(f"sqlite:///{path}", lock_seconds=5)
    migrate(database)
    begin(Pipelines(DEFAULT), database)
    for number in numbers:
        new = NewShape(
            small_file(number),
            "off",
            DEFAULT_COLLECTION.number,
            str(number),
            (f"tag {number}",),
            {"number": number},
        )
        made = embedded(number)
        with database.write() as session:
            blob = file_repository.add_blob(session, new.data, new.sha256)
            file_repository.add_embedding(session, blob, new.format, DEFAULT.fingerprint, made)
            repository.add_shape(session, blob, new, made.facts)
    database.close()
    return path


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The file, as whoever knows no rules would open it: without foreign keys, each statement for itself."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        yield connection


def change(path: Path, statement: str, *values: object) -> None:
    with opened(path) as connection:
        connection.execute(statement, values)


def contents(path: Path) -> dict[str, list[str]]:
    """Everything that a file holds: the rows of each table, in one order, and the schema."""
    with opened(path) as connection:
        tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        return {
            name: sorted(map(repr, connection.execute(f"SELECT * FROM {name}")))
            for (name,) in [("sqlite_master",), *tables]
        }


def names(path: Path) -> list[str]:
    with opened(path) as connection:
        return [name for (name,) in connection.execute("SELECT name FROM shapes ORDER BY number")]
