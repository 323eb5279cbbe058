"""What SQLite is told, and where it is not trusted."""

from pathlib import Path

import pytest
from sqlalchemy import text

from service.errors import StorageUnavailableError
from service.storage.database import Database
from service.storage.migrate import migrate
from service.storage.sqlite import journal_mode, write_ahead_log_is_safe


def open_database(path: Path) -> Database:
    return Database(f"sqlite:///{path}", lock_seconds=0.3)


def test_connections_are_set_up_to_lose_nothing(tmp_path: Path) -> None:
    database = open_database(tmp_path / "archive.sqlite3")
    with database.read() as session:
        connection = session.connection()
        said = {
            pragma: connection.execute(text(f"PRAGMA {pragma}")).scalar_one()
            for pragma in ("foreign_keys", "synchronous", "journal_mode", "busy_timeout")
        }
    assert said == {"foreign_keys": 1, "synchronous": 2, "journal_mode": journal_mode(), "busy_timeout": 300}
    database.close()


@pytest.mark.parametrize(
    ("version", "safe"),
    [
        ((3, 40, 1), False),
        ((3, 44, 5), False),
        ((3, 44, 6), True),
        ((3, 45, 0), False),
        ((3, 46, 1), False),
        ((3, 50, 6), False),
        ((3, 50, 7), True),
        ((3, 51, 2), False),
        ((3, 51, 3), True),
        ((3, 52, 0), True),
        ((4, 0, 0), True),
    ],
)
def test_the_write_ahead_log_is_used_only_where_it_is_sound(
    version: tuple[int, int, int], safe: bool
) -> None:
    assert write_ahead_log_is_safe(version) is safe


def test_a_file_that_is_no_database_is_said(tmp_path: Path) -> None:
    path = tmp_path / "archive.sqlite3"
    path.write_bytes(b"this is no database at all, however long it may be" * 100)
    database = open_database(path)
    with pytest.raises(StorageUnavailableError, match="SQLITE_NOTADB"):
        migrate(database)
    with pytest.raises(StorageUnavailableError):
        database.ping()
    database.close()


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailableError, match="folder"):
        open_database(tmp_path / "file" / "archive.sqlite3")


def test_the_folder_of_a_file_is_made(tmp_path: Path) -> None:
    path = tmp_path / "a folder" / "that is not there" / "archive.sqlite3"
    database = open_database(path)
    migrate(database)
    database.ping()
    database.close()
    assert path.is_file()
