"""An archive copied to PostgreSQL and back: everything, or nothing."""

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import select
from typer.testing import CliRunner

from service.cli.commands import command_line
from service.collection import DEFAULT_COLLECTION
from service.collections import repository as sets
from service.errors import ArchiveError, ArchiveTooNewError
from service.http.idempotency import Claim, Kept
from service.shapes import file_repository, repository
from service.shapes.records import NewShape
from service.storage.checking import CheckReport, check
from service.storage.checksums import checksum_of
from service.storage.copying import copy_archive
from service.storage.database import Database
from service.storage.tables import ShapeRow, ThumbnailRow
from tests.service.archives import change, embedded, make_archive
from tests.service.engines import bare, empty_database, on_postgresql
from tests.service.support import query, serving, settings_in, small_file

pytestmark = on_postgresql


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """An archive with a row in every table, the last shape of which was deleted."""
    path = make_archive(tmp_path / "archive.sqlite3", 1, 2, 3, 4)
    with opened(file(path)) as database, database.write() as session:
        sets.create(session, "second")
        second = sets.get(session, "second")
        assert second is not None
        twin = NewShape(
            small_file(1),
            "off",
            second.number,
            "tw\u00efn \U0001f600",
            ("a", "B", "\u00e4"),
            {"k\0": "\\0", "n": [1.5, None]},
        )
        blob = file_repository.blob_number(session, twin.sha256)
        assert blob is not None
        repository.add_shape(session, blob, twin, embedded(1).facts)
        picture = b"\0\xff"
        own = {"blob_number": blob, "format": "off", "size": 128, "drawing": 1}
        session.add(ThumbnailRow(**own, data=picture, checksum=checksum_of(picture)))
        now = datetime.now(UTC)
        claim = Claim(DEFAULT_COLLECTION.number, "", "key", "payload", now + timedelta(hours=1))
        repository.keep_answer(session, claim, Kept(201, "/shapes/x", "{}"), now)
        number = session.scalars(select(ShapeRow.number).where(ShapeRow.name == "4")).one()
        own = DEFAULT_COLLECTION.number
        repository.delete_shape(session, repository.records(session, own, [number])[0])
    return path


def file(path: Path) -> str:
    return f"sqlite:///{path}"


@contextmanager
def opened(url: str) -> Iterator[Database]:
    with closing(Database(url, lock_seconds=5)) as database:
        yield database


def copied(source: str, target: str) -> CheckReport:
    with opened(source) as origin, opened(target) as copy:
        return copy_archive(origin, copy, lambda *_: None)


def content(path: Path) -> Counter[str]:
    """Every row of every table, and the counters, as statements that write them."""
    with closing(sqlite3.connect(path)) as connection:
        return Counter(connection.iterdump())


def test_an_archive_is_the_same_when_it_comes_back(archive: Path, tmp_path: Path) -> None:
    before, url = content(archive), empty_database()
    there = copied(file(archive), url)
    assert (there.shapes, there.blobs, there.embeddings) == (4, 4, 4)
    assert there.bytes == sum(len(small_file(number)) for number in (1, 2, 3, 4))
    assert copied(url, file(tmp_path / "back.sqlite3")) == there
    assert content(tmp_path / "back.sqlite3") == before == content(archive)
    assert check(tmp_path / "back.sqlite3", lock_seconds=1).faults == []


def test_a_number_that_was_given_is_not_given_again(archive: Path, tmp_path: Path) -> None:
    url, back = empty_database(), file(tmp_path / "back.sqlite3")
    change(archive, "UPDATE sqlite_sequence SET seq = 70 WHERE name = 'shapes'")
    copied(file(archive), url)
    copied(url, back)
    for place in (url, back):
        with opened(place) as database, database.write() as session:
            new = NewShape(b"new", "off", DEFAULT_COLLECTION.number, "new", (), {})
            shape = repository.add_shape(
                session, file_repository.add_blob(session, b"new", new.sha256), new, {}
            )
            assert shape.number == 71
            assert session.scalars(select(ShapeRow.blob_number).where(ShapeRow.number == 71)).one() == 5


def test_a_target_that_is_not_empty_is_left_alone(archive: Path, tmp_path: Path) -> None:
    other = make_archive(tmp_path / "other.sqlite3", 7)
    before = content(other)
    with pytest.raises(ArchiveError, match="not empty"):
        copied(file(archive), file(other))
    assert content(other) == before
    with opened(file(other)) as database, database.write() as session:
        (number,) = session.scalars(select(ShapeRow.number))
        repository.erase_shape(session, repository.records(session, DEFAULT_COLLECTION.number, [number])[0])
    with pytest.raises(ArchiveError, match="not empty"):
        copied(file(archive), file(other))


def test_an_archive_that_a_service_began_is_empty(archive: Path, tmp_path: Path) -> None:
    begun = make_archive(tmp_path / "begun.sqlite3")
    copied(file(archive), file(begun))
    assert content(begun) == content(archive)


@pytest.mark.parametrize("data", ["x'00ff'", "'text'", "x''"])
def test_a_file_that_is_not_what_its_hash_says_stops_the_copy(archive: Path, data: str) -> None:
    change(archive, f"UPDATE blobs SET data = {data} WHERE number = 2")
    url = empty_database()
    with pytest.raises(ArchiveError, match="blobs row 2 of the source does not have the SHA-256"):
        copied(file(archive), url)
    with opened(url) as database, database.read() as session:
        assert session.scalars(select(ShapeRow.number)).all() == []


def test_a_copy_that_is_not_the_same_is_not_kept(archive: Path) -> None:
    url = empty_database(migrated=True)
    with bare(url) as connection:
        connection.exec_driver_sql(
            "CREATE FUNCTION spoil() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
            "NEW.tag := upper(NEW.tag); RETURN NEW; END $$; "
            "CREATE TRIGGER spoil BEFORE INSERT ON shape_tags FOR EACH ROW EXECUTE FUNCTION spoil()"
        )
    with pytest.raises(ArchiveError, match=r"shape_tags is not the same"):
        copied(file(archive), url)
    with opened(url) as database, database.read() as session:
        assert session.scalars(select(ShapeRow.number)).all() == []


def test_a_file_that_is_no_archive_or_of_another_version_is_not_copied(archive: Path, tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="no Isoshape archive"):
        copied(empty_database(), file(tmp_path / "copy.sqlite3"))
    change(archive, "CREATE TABLE notes (number INTEGER PRIMARY KEY)")
    url = empty_database()
    with pytest.raises(ArchiveError, match="notes"):
        copied(file(archive), url)
    change(archive, "UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(ArchiveTooNewError):
        copied(file(archive), url)


def test_the_command(archive: Path, tmp_path: Path) -> None:
    def run(*arguments: object) -> tuple[int, str]:
        done = CliRunner().invoke(command_line(), ["copy", *map(str, arguments)])
        return done.exit_code, done.output

    url = empty_database()
    size = sum(len(small_file(number)) for number in (1, 2, 3, 4))
    assert run(archive, url) == (
        0,
        f"4 shapes on 4 files of {size} bytes, 4 embeddings: copied, and compared row by row\n",
    )
    status, said = run(archive, url)
    assert (status, "the target is not empty" in said) == (1, True)
    status, said = run(tmp_path / "nothing.sqlite3", empty_database())
    assert (status, "there is no archive at" in said) == (1, True)
    assert not (tmp_path / "nothing.sqlite3").exists()
    status, said = run(archive, archive)
    assert (status, "onto itself" in said) == (1, True)
    status, said = run(archive, "mysql://me:secret@host/archive")
    assert (status, "TARGET: must name" in said, "secret" in said) == (2, True, False)
    assert run(url, tmp_path / "back.sqlite3")[0] == 0
    assert content(tmp_path / "back.sqlite3") == content(archive)


def test_a_copy_answers_as_its_source_does(tmp_path: Path) -> None:
    path = make_archive(tmp_path / "archive.sqlite3", *range(12))
    settings = settings_in(tmp_path)
    url = empty_database()
    copied(file(path), url)

    def answers(database_url: str) -> list[object]:
        with serving(settings.model_copy(update={"database_url": database_url})) as running:
            told: list[object] = [running.client.get("/shapes", params={"limit": 500}).json()]
            for number in (3, 20, 21):
                answer = query(running.client, small_file(number), top_k=12, exclude_self="false").json()
                told.append({**answer, "milliseconds": 0})
            return told

    assert answers(url) == answers(file(path))
