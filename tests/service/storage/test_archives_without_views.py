"""An archive of before embeddings had views: it answers as before, until `isoshape reembed` adds them."""

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from core.parameters import DEFAULT
from core.serialization import descriptors_from_bytes
from service.shapes.reembedding import Reembedding
from service.storage.checking import check
from tests.service.archives import opened
from tests.service.pipeline_files import active, fingerprints
from tests.service.storage.archives.before_views.make import SCORES, answers, queries
from tests.service.support import Running, query, serving, settings_in

ARCHIVE = Path(__file__).with_name("archives") / "before_views" / "without_views.sqlite3"
BEFORE: dict[str, Any] = json.loads(ARCHIVE.with_suffix(".json").read_text(encoding="utf-8"))
FINGERPRINT = BEFORE["version"]["fingerprint"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(ARCHIVE, tmp_path / "archive.sqlite3")
    return tmp_path


def assert_answers_as_before(running: Running) -> None:
    now = answers(running)
    assert now["answers"] == BEFORE["answers"]
    assert now["compared"] == BEFORE["compared"]


def test_no_fingerprint_of_before_changes_its_meaning() -> None:
    assert DEFAULT.with_values(views=False, orientation=False).fingerprint == FINGERPRINT
    assert DEFAULT.fingerprint != FINGERPRINT


def test_it_answers_as_before_and_says_what_reembed_adds(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with serving(settings_in(folder, workers=1, log_level="warning")) as running:
        assert_answers_as_before(running)
        told = running.client.get("/version").json()
        pending = told.pop("pending")
        assert told == {name: value for name, value in BEFORE["version"].items() if name != "pending"}
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
    assert set(fingerprints(folder)) == {FINGERPRINT}
    with opened(folder / "archive.sqlite3") as connection:
        found = connection.execute("SELECT DISTINCT view_signature, reliability FROM sketches").fetchall()
    assert found == [(None, None)]


def test_reembed_adds_the_views_while_the_service_answers(folder: Path) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        container = running.container
        reembedding = Reembedding(container.database, container.work, DEFAULT)
        seen = []

        def look(_done: int, _total: int) -> None:
            answer = query(running.client, queries()["small"], rank_by="combined").json()
            seen.append(answer["pipeline"])
            assert answer["results"][0]["combined"] == BEFORE["answers"][2]["results"][0]["combined"]

        outcome = asyncio.run(reembedding.run(at_once=1, leave_out=False, advance=look))
        assert (outcome.made, outcome.refused, outcome.active) == (3, [], True)
        assert set(seen) == {FINGERPRINT}
        assert running.client.get("/version").json()["pending"] is None
        answer = query(running.client, queries()["small"], rank_by="combined", top_k=10).json()
        assert (answer["pipeline"], answer["compared"]) == (DEFAULT.fingerprint, 3)
        was = {result["name"]: result for result in BEFORE["answers"][0]["results"]}
        for result in answer["results"]:
            expected = was[result["shape"]["name"]]
            assert [result[score] for score in SCORES[:3]] == [expected[score] for score in SCORES[:3]]
            assert result["combined"] != expected["combined"]
        with container.database.read() as session:
            records = session.execute(
                text("SELECT record FROM embeddings WHERE fingerprint = :one"), {"one": DEFAULT.fingerprint}
            ).scalars()
            assert all(descriptors_from_bytes(record).views.size for record in records)
        assert reembedding.prune() == 3
    assert set(fingerprints(folder)) == {active(folder)} == {DEFAULT.fingerprint}
    assert check(folder / "archive.sqlite3", lock_seconds=1).faults == []
