"""`isoshape reembed`: files that cannot be embedded, other pipelines, and nothing to do."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from core.parameters import DEFAULT, Parameters
from service.cli.archives import bring_up
from service.collection import DEFAULT_COLLECTION
from service.pipelines import repository
from service.settings import load_settings
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes.records import NewShape
from service.storage.database import Database, migrate
from tests.service.cli.conftest import Run
from tests.service.pipeline_files import active, embeddings, write_parameters
from tests.service.support import small_file


@pytest.fixture
def few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Parameters:
    """An archive whose files no pipeline has embedded, and the settings that name it and another pipeline."""
    return archive_to_reembed(tmp_path, monkeypatch, 3)


def archive_to_reembed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stored: int) -> Parameters:
    """Store so many shapes without embeddings; the pipeline that the settings name."""
    few = write_parameters(tmp_path)
    url = f"sqlite:///{tmp_path}/archive.sqlite3"
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", url)
    monkeypatch.setenv("ISOSHAPE_PIPELINE", str(tmp_path / "few.json"))
    database = Database(url, lock_seconds=5)
    migrate(database)
    with database.write() as session:
        repository.keep(session, DEFAULT)
        repository.activate(session, DEFAULT.fingerprint)
        for number in range(stored):
            data = small_file(number)
            new = NewShape(data, "off", DEFAULT_COLLECTION.number, f"{number}.off", tags=(), metadata={})
            blob = file_repository.add_blob(session, data, new.sha256)
            shapes_repository.add_shape(session, blob, new, {})
    database.close()
    return few


def test_files_that_cannot_be_embedded_are_named_and_may_be_left_out(
    tmp_path: Path, few: Parameters, run: Run
) -> None:
    with closing(sqlite3.connect(tmp_path / "archive.sqlite3")) as connection, connection:
        connection.execute("UPDATE blobs SET data = CAST('no mesh' AS BLOB) WHERE number = 2")
    refused = run("reembed", "--prune")
    assert refused.status == 1
    assert refused.stdout == f"2 embedded by pipeline few ({few.fingerprint}), 1 cannot be\n"
    assert "1.off: " in refused.stderr
    assert "--leave-out" in refused.stderr.splitlines()[-1]
    assert active(tmp_path) == DEFAULT.fingerprint
    left_out = run("reembed", "--leave-out")
    assert (left_out.status, left_out.stdout) == (
        0,
        f"0 embedded by pipeline few ({few.fingerprint}), 1 cannot be, the archive is searched by it\n",
    )
    assert active(tmp_path) == few.fingerprint
    with closing(sqlite3.connect(tmp_path / "archive.sqlite3")) as connection, connection:
        connection.execute(
            "INSERT INTO embeddings SELECT number + 10, blob_number, format, 'an-older-one', signature, "
            "record, checksum FROM embeddings"
        )
        connection.execute("DELETE FROM shapes WHERE number = 2")
    pruned = run("reembed", "--prune")
    assert (pruned.status, pruned.stdout) == (
        0,
        f"0 embedded by pipeline few ({few.fingerprint}), the archive is searched by it, "
        "2 embeddings of other pipelines deleted\n",
    )
    assert embeddings(tmp_path) == [(1, few.fingerprint), (2, few.fingerprint)]


def test_a_demonstration_is_brought_up_to_the_pipeline_that_is_named(
    tmp_path: Path, few: Parameters, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(sqlite3.connect(tmp_path / "archive.sqlite3")) as connection, connection:
        connection.execute("DELETE FROM shapes WHERE number > 2")
    bring_up(load_settings())
    assert "by another pipeline" in capsys.readouterr().err
    assert active(tmp_path) == few.fingerprint
    assert embeddings(tmp_path) == [(1, few.fingerprint), (2, few.fingerprint)]
    bring_up(load_settings())
    assert capsys.readouterr().err == ""


def test_nothing_to_do_is_said_and_starts_no_worker(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive_to_reembed(tmp_path, monkeypatch, 1)
    assert run("reembed").status == 0
    monkeypatch.setattr("service.cli.archives.start_executors", None)
    again = run("reembed")
    assert again.status == 0
    assert again.stdout.startswith("nothing to do: pipeline ")
    assert again.stdout.endswith(" is active and has embedded every stored shape\n")
    pruned = run("reembed", "--prune")
    assert (pruned.status, pruned.stdout) == (0, again.stdout)
