"""Archives that earlier versions wrote open in this one; what a newer one wrote is refused."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from core.descriptors.reliability import intrinsic_reliability
from core.descriptors.view_signature import view_signature
from core.parameters import DEFAULT
from core.ranking.coarse_ranking import coarse_samples
from core.ranking.quantised_points import quantised_points
from core.serialization import embedding_from_bytes
from service.cli.reembed import reembed
from service.errors import PipelineUnavailableError
from service.pipelines.active import Pipelines
from service.pipelines.starting import begin
from service.storage.checking import check
from service.storage.database import Database
from service.storage.migrate import migrate
from tests.service.archives import begin_at, make_archive, opened
from tests.service.pipeline_files import active, fingerprints
from tests.service.support import query, serving, settings_in

ARCHIVES = Path(__file__).with_name("archives")
RELEASES = sorted(path.stem for path in ARCHIVES.glob("*.sqlite3"))


def told(release: str) -> dict[str, Any]:
    """What the release answered about its archive."""
    answers = json.loads((ARCHIVES / f"{release}.json").read_text(encoding="utf-8"))
    assert isinstance(answers, dict)
    return answers


@pytest.fixture(params=RELEASES)
def release(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A release, whose archive is in the folder now."""
    shutil.copy(ARCHIVES / f"{request.param}.sqlite3", tmp_path / "archive.sqlite3")
    return str(request.param)


def test_there_is_an_archive_of_each_release() -> None:
    assert "0.1.0" in RELEASES
    for name in RELEASES:
        assert told(name)["version"]["version"] == name
        assert told(name)["shapes"]


def test_an_archive_of_a_release_is_served(release: str, tmp_path: Path) -> None:
    before = told(release)
    settings = settings_in(tmp_path, workers=1)
    outcome, _ = reembed(settings, DEFAULT, prune=True)
    assert outcome.active
    assert set(fingerprints(tmp_path)) == {active(tmp_path)} == {DEFAULT.fingerprint}
    with serving(settings) as running:
        shapes = running.client.get("/shapes").json()["shapes"]
        # Another method may measure otherwise, and a newer version may tell more.
        for shape, was in zip(shapes, before["shapes"], strict=True):
            assert {**{key: shape[key] for key in was}, "facts": 0} == {**was, "facts": 0}
        for shape in shapes:
            data = running.client.get(f"/shapes/{shape['id']}/file").content
            assert hashlib.sha256(data).hexdigest() == shape["sha256"]
            answer = query(running.client, data, f"x.{shape['format']}", exclude_self="false").json()
            assert (answer["compared"], answer["stored"]) == (len(shapes), len(shapes))
            assert answer["results"][0]["shape"]["sha256"] == shape["sha256"]
            assert answer["results"][0]["cc"] == pytest.approx(1.0)
    assert check(tmp_path / "archive.sqlite3", lock_seconds=1).faults == []


def test_an_archive_of_a_release_has_its_pipeline_in_use_until_it_is_embedded_anew(
    release: str, tmp_path: Path
) -> None:
    fingerprint = told(release)["version"]["fingerprint"]
    database = Database(f"sqlite:///{tmp_path}/archive.sqlite3", lock_seconds=1)
    migrate(database)
    assert active(tmp_path) == fingerprint
    with database.write() as session:
        # As if a method that is no more had made it.
        session.execute(text("UPDATE embeddings SET fingerprint = '00112233445566ff'"))
        session.execute(text("UPDATE archive SET fingerprint = '00112233445566ff'"))
    with pytest.raises(PipelineUnavailableError, match="isoshape reembed"):
        begin(Pipelines(DEFAULT), database)
    database.close()
    assert check(tmp_path / "archive.sqlite3", lock_seconds=1).shapes == len(told(release)["shapes"])


def test_an_archive_of_several_pipelines_is_searched_by_the_one_that_embedded_most(tmp_path: Path) -> None:
    shutil.copy(ARCHIVES / "0.1.0.sqlite3", tmp_path / "archive.sqlite3")
    database = Database(f"sqlite:///{tmp_path}/archive.sqlite3", lock_seconds=1)
    with database.write() as session:
        session.execute(
            text(
                "INSERT INTO embeddings (blob_number, format, fingerprint, signature, record) "
                "SELECT blob_number, format, 'another-pipeline', signature, record FROM embeddings LIMIT 1"
            )
        )
    migrate(database)
    database.close()
    assert active(tmp_path) == told("0.1.0")["version"]["fingerprint"]


SKETCHES = "SELECT embedding_number, data, signature, view_signature, reliability FROM sketches"


def test_embeddings_that_had_no_sketches_get_those_and_their_signatures(tmp_path: Path) -> None:
    path = make_archive(tmp_path / "archive.sqlite3", 1, 2, 3)
    with opened(path) as connection:
        made = {row[0]: row[1:] for row in connection.execute(SKETCHES)}
        records = dict(connection.execute("SELECT number, record FROM embeddings"))
        for number, record in records.items():
            embedding = embedding_from_bytes(record)
            assert made[number] == (
                coarse_samples(embedding).tobytes(),
                embedding.signature.tobytes(),
                view_signature(embedding.views).tobytes(),
                intrinsic_reliability(embedding.facts),
            )
        connection.execute("UPDATE embeddings SET record = x'00' WHERE number = 2")
    older = tmp_path / "older.sqlite3"
    begin_at(f"sqlite:///{older}", "0005")
    with opened(older) as connection:
        connection.execute("ATTACH ? AS made", (str(path),))
        for table in ("blobs", "shapes", "embeddings"):
            columns = ", ".join(
                name for (name,) in connection.execute("SELECT name FROM pragma_table_info(?)", (table,))
            )
            connection.execute(f"INSERT INTO {table} ({columns}) SELECT {columns} FROM made.{table}")
    database = Database(f"sqlite:///{older}", lock_seconds=1)
    migrate(database)
    database.close()
    with opened(older) as connection:
        found = {row[0]: row[1:] for row in connection.execute(SKETCHES)}
    # Archives of that time have no views.
    without_views = {number: (*row[:2], None, None) for number, row in made.items()}
    assert found == {**without_views, 2: (b"", made[2][1], None, None)}


POINTS = "SELECT embedding_number, data, checksum FROM points"


def test_embeddings_that_had_no_points_get_them(tmp_path: Path) -> None:
    path = make_archive(tmp_path / "archive.sqlite3", 1, 2, 3)
    older = tmp_path / "older.sqlite3"
    begin_at(f"sqlite:///{older}", "0012")
    with opened(path) as connection:
        made = connection.execute(POINTS).fetchall()
        (record,) = connection.execute("SELECT record FROM embeddings WHERE number = 2").fetchone()
        assert made[1][1] == quantised_points(embedding_from_bytes(record))
        connection.execute("UPDATE embeddings SET record = x'00', checksum = NULL WHERE number = 3")
        connection.execute("UPDATE embeddings SET checksum = 'another' WHERE number = 1")
    with opened(older) as connection:
        connection.execute("ATTACH ? AS made", (str(path),))
        for table in ("blobs", "shapes", "embeddings"):
            connection.execute(f"INSERT INTO {table} SELECT * FROM made.{table}")
    database = Database(f"sqlite:///{older}", lock_seconds=1)
    migrate(database)
    database.close()
    with opened(older) as connection:
        assert connection.execute(POINTS).fetchall() == made[1:2]
