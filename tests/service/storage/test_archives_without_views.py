"""An archive of before embeddings had views: it answers as before, until `isoshape reembed` adds them."""

from pathlib import Path

import pytest

from core.parameters import DEFAULT
from core.serialization import descriptors_from_bytes
from tests.core.parameters.earlier_parameters import BEFORE_VIEWS
from tests.service.archives import opened
from tests.service.pipeline_files import fingerprints
from tests.service.storage.archives.before_views.make import SCORES, queries
from tests.service.storage.earlier_archives import EarlierArchive, assert_sound, records
from tests.service.support import query, serving, settings_in

ARCHIVE = EarlierArchive(Path(__file__).with_name("archives") / "before_views" / "without_views.sqlite3")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ARCHIVE.copy_to(tmp_path)
    return tmp_path


def test_its_fingerprint_keeps_its_meaning() -> None:
    assert BEFORE_VIEWS.fingerprint == ARCHIVE.fingerprint
    assert DEFAULT.fingerprint != ARCHIVE.fingerprint


def test_it_answers_as_before_and_says_what_reembed_adds(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with serving(settings_in(folder, workers=1, log_level="warning")) as running:
        ARCHIVE.assert_answers_as_before(running)
        told = running.client.get("/version").json()
        pending = told.pop("pending")
        assert told == {name: value for name, value in ARCHIVE.before["version"].items() if name != "pending"}
        assert (pending["fingerprint"], pending["embedded"], pending["files"]) == (DEFAULT.fingerprint, 0, 3)
        assert "isoshape reembed" in pending["message"]
        assert "views" in pending["message"]
        assert any("`isoshape reembed`" in line and "views" in line for line in caplog.messages)
        # New shapes join the pipeline of before, without views.
        data = queries()["small"]
        running.client.post("/shapes", files={"file": ("new.off", data)}).raise_for_status()
        assert query(running.client, data, rank_by="combined").json()["results"][0]["cc"] == pytest.approx(
            1.0
        )
    assert set(fingerprints(folder)) == {ARCHIVE.fingerprint}
    with opened(folder / "archive.sqlite3") as connection:
        found = connection.execute("SELECT DISTINCT view_signature, reliability FROM sketches").fetchall()
    assert found == [(None, None)]


def test_reembed_adds_the_views_while_the_service_answers(folder: Path) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        before = ARCHIVE.before["answers"]
        for answer in ARCHIVE.reembed(running):
            assert answer["results"][0]["combined"] == before[2]["results"][0]["combined"]
        answer = query(running.client, queries()["small"], rank_by="combined", top_k=10).json()
        assert (answer["pipeline"], answer["compared"]) == (DEFAULT.fingerprint, 3)
        was = {result["name"]: result for result in before[0]["results"]}
        for result in answer["results"]:
            expected = was[result["shape"]["name"]]
            assert [result[score] for score in SCORES[:3]] == [expected[score] for score in SCORES[:3]]
            assert result["combined"] != expected["combined"]
        assert all(descriptors_from_bytes(record).views.size for record in records(running))
    assert_sound(folder)
