"""Faults that only a database server has: go away, come back, and be set up as an archive cannot use it."""

import importlib.util
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from service.cli.commands import command_line
from service.errors import ArchiveError, StorageUnavailableError
from service.storage import postgresql
from service.storage.checking import check
from service.storage.copying import copy_archive
from service.storage.database import Database, migrate
from tests.service.engines import bare, empty_database, on_postgresql, standing_still, stopped, url_in
from tests.service.support import assert_problem, query, serving, settings_in, small_file, upload, wait_until

pytestmark = on_postgresql

WRITERS = 4
FILES = 6


@pytest.mark.parametrize("mode", ["immediate", "fast"])
def test_a_server_that_goes_away_under_load(tmp_path: Path, mode: str) -> None:
    """The service answers meanwhile, and keeps what it acknowledged."""
    acknowledged: dict[str, str] = {}
    counted: Counter[int] = Counter()
    wrong: list[str] = []
    over = threading.Event()

    def note(answer: httpx.Response) -> httpx.Response:
        counted[answer.status_code] += 1
        if answer.status_code >= 500 and "storage-unavailable" not in answer.text:
            wrong.append(answer.text)
        return answer

    def write(client: httpx.Client, number: int) -> None:
        while not over.is_set():
            answer = note(upload(client, small_file(number % FILES), f"{number}.off"))
            if answer.status_code == 201:
                acknowledged[answer.json()["id"]] = f"{number}.off"
                number += WRITERS
            elif answer.status_code == 200:
                # It was stored, though the answer was lost with the server.
                number += WRITERS
            else:
                time.sleep(0.05)

    def ask(client: httpx.Client) -> None:
        while not over.is_set():
            note(query(client, small_file(0), top_k=1))
            time.sleep(0.05)

    with serving(settings_in(tmp_path, lock_seconds=5)) as running:
        client = running.client
        load: list[Callable[[], None]] = [lambda: ask(client)]
        load += [lambda first=first: write(client, first) for first in range(WRITERS)]
        threads = [threading.Thread(target=each) for each in load]
        for thread in threads:
            thread.start()
        try:
            wait_until(lambda: len(acknowledged) >= 8, seconds=60)
            with stopped(mode):
                failed = counted[503]
                wait_until(lambda: counted[503] >= failed + 5, seconds=30)
                assert client.get("/healthz").status_code == 200
                assert_problem(client.get("/readyz"), 503, "not-ready")
                assert_problem(client.get("/shapes"), 503, "storage-unavailable")
            wait_until(lambda: client.get("/readyz").status_code == 200, seconds=30)
            many = len(acknowledged)
            wait_until(lambda: len(acknowledged) >= many + 8, seconds=60)
        finally:
            over.set()
            for thread in threads:
                thread.join()
        assert wrong == []
        assert set(counted) == {200, 201, 503} or set(counted) == {201, 503}
        names = {shape_id: client.get(f"/shapes/{shape_id}").json()["name"] for shape_id in acknowledged}
        assert names == acknowledged
    copy = tmp_path / "copy.sqlite3"
    with (
        closing(Database(url_in(tmp_path), lock_seconds=5)) as origin,
        closing(Database(f"sqlite:///{copy}", lock_seconds=5)) as target,
    ):
        copy_archive(origin, target, lambda *_: None)
    report = check(copy, lock_seconds=1)
    assert report.faults == []
    assert report.shapes >= len(acknowledged)


def test_a_server_that_stands_still_leaves_no_request_unanswered(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path)) as running:
        shape_id = upload(running.client, small_file(0), "a.off").json()["id"]
        with standing_still():
            for path in ("/shapes", f"/shapes/{shape_id}", "/readyz"):
                start = time.monotonic()
                assert_problem(
                    running.client.get(path),
                    503,
                    "storage-unavailable" if "readyz" not in path else "not-ready",
                )
                assert time.monotonic() - start < 20
        wait_until(lambda: running.client.get("/readyz").status_code == 200, seconds=60)
        assert running.client.get(f"/shapes/{shape_id}").status_code == 200
        assert upload(running.client, small_file(1), "b.off").status_code == 201


def test_a_server_that_is_not_there_is_said_at_the_start(tmp_path: Path) -> None:
    url = url_in(tmp_path)
    with stopped("fast"), closing(Database(url, lock_seconds=1)) as database:
        with pytest.raises(StorageUnavailableError, match="OperationalError"):
            migrate(database)
        with pytest.raises(StorageUnavailableError):
            database.ping()
    with closing(Database(url, lock_seconds=1)) as database:
        database.ping()


def test_sessions_are_isolated_and_wait_no_longer_than_told() -> None:
    with closing(Database(empty_database(migrated=True), lock_seconds=0.25)) as database:
        for session_of, level in ((database.read, "repeatable read"), (database.write, "read committed")):
            with session_of() as session:
                connection = session.connection()
                assert connection.execute(text("SHOW transaction_isolation")).scalar_one() == level
                assert connection.execute(text("SHOW lock_timeout")).scalar_one() == "250ms"


def test_an_option_of_the_url_is_kept() -> None:
    url = empty_database(migrated=True) + "&options=-c%20work_mem%3D3MB&application_name=mine"
    with closing(Database(url, lock_seconds=2)) as database, database.read() as session:
        connection = session.connection()
        shown = [
            connection.execute(text(f"SHOW {name}")).scalar_one()
            for name in ("work_mem", "lock_timeout", "application_name")
        ]
    assert shown == ["3MB", "2s", "mine"]


def test_a_database_of_another_encoding_is_refused() -> None:
    url = empty_database(encoding="SQL_ASCII")
    with closing(Database(url, lock_seconds=1)) as database, pytest.raises(ArchiveError, match="SQL_ASCII"):
        migrate(database)


def test_a_server_without_pgvector_is_refused() -> None:
    url = empty_database()
    with bare(url) as connection:
        # Looked up before the server's own, which lists what is installed.
        connection.exec_driver_sql("CREATE VIEW pg_available_extensions AS SELECT 'plpgsql' AS name")
    url += "&options=-c%20search_path%3Dpublic,pg_catalog"
    with closing(Database(url, lock_seconds=1)) as database, pytest.raises(ArchiveError, match="pgvector"):
        migrate(database)


def test_a_driver_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(postgresql, "find_spec", lambda name: None if name == "psycopg" else find_spec(name))
    with pytest.raises(ArchiveError, match=r"isoshape\[postgres\]"):
        Database("postgresql://localhost/archive", lock_seconds=1)


@pytest.mark.parametrize("command", ["check", "backup", "recover"])
def test_commands_for_a_file_say_what_to_use(
    tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", "postgresql://me:secret@db.example/archive")
    arguments = [command] if command == "check" else [command, str(tmp_path / "file")]
    done = CliRunner().invoke(command_line(), arguments)
    assert done.exit_code == 1
    assert "pg_dump" in done.output
    assert "isoshape copy" in done.output
    assert "secret" not in done.output
    assert list(tmp_path.iterdir()) == []
