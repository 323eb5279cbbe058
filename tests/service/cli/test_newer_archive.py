"""An archive that a newer version wrote is refused, and left as it is, by what would open it."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from service.storage.database import Database, migrate
from tests.service.cli.conftest import Run


@pytest.mark.parametrize("command", [["serve", "--port", "0"], ["reembed"], ["check"], ["query", "x.off"]])
def test_a_newer_archive_is_refused_with_a_clear_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run, command: list[str]
) -> None:
    path = tmp_path / "archive.sqlite3"
    Path("x.off").write_text("OFF", encoding="utf-8")
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", f"sqlite:///{path}")
    database = Database(f"sqlite:///{path}", lock_seconds=1)
    migrate(database)
    database.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    before = path.read_bytes()
    done = run(*command)
    assert done.status == 1
    assert "9999" in done.stderr.splitlines()[-1]
    assert "newer" in done.stderr.splitlines()[-1]
    assert path.read_bytes() == before
