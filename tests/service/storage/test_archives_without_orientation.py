"""An archive whose embeddings have no orientation: it answers as before, until `isoshape reembed` adds it."""

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from core.parameters import DEFAULT
from core.serialization import embedding_from_bytes
from service.shapes.reembedding import Reembedding
from service.storage.checking import check
from tests.service.pipeline_files import active, fingerprints
from tests.service.storage.archives.before_views.make import answers, queries
from tests.service.support import query, serving, settings_in

ARCHIVE = Path(__file__).with_name("archives") / "before_orientation" / "without_orientation.sqlite3"
BEFORE: dict[str, Any] = json.loads(ARCHIVE.with_suffix(".json").read_text(encoding="utf-8"))
FINGERPRINT = BEFORE["version"]["fingerprint"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(ARCHIVE, tmp_path / "archive.sqlite3")
    return tmp_path


def test_its_fingerprint_keeps_its_meaning() -> None:
    assert DEFAULT.with_values(orientation=False).fingerprint == FINGERPRINT
    assert DEFAULT.fingerprint != FINGERPRINT


def test_it_answers_as_before_and_says_what_reembed_adds(folder: Path) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        now = answers(running)
        assert now["answers"] == BEFORE["answers"]
        assert now["compared"] == BEFORE["compared"]
        pending = running.client.get("/version").json()["pending"]
        assert (pending["fingerprint"], pending["embedded"], pending["files"]) == (DEFAULT.fingerprint, 0, 3)
        assert "orientation" in pending["message"]
        assert "views" not in pending["message"]
        # New shapes join the pipeline of before.
        running.client.post("/shapes", files={"file": ("new.off", queries()["small"])}).raise_for_status()
    assert set(fingerprints(folder)) == {FINGERPRINT}


def test_reembed_adds_orientation_and_changes_no_score(folder: Path) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        container = running.container
        reembedding = Reembedding(container.database, container.work, DEFAULT)
        seen = []

        def look(_done: int, _total: int) -> None:
            seen.append(query(running.client, queries()["small"], rank_by="combined").json()["pipeline"])

        outcome = asyncio.run(reembedding.run(at_once=1, leave_out=False, advance=look))
        assert (outcome.made, outcome.refused, outcome.active) == (3, [], True)
        assert set(seen) == {FINGERPRINT}
        now = answers(running)
        assert now["version"]["fingerprint"] == DEFAULT.fingerprint
        assert now["version"]["pending"] is None
        assert now["answers"] == BEFORE["answers"]
        assert now["compared"] == BEFORE["compared"]
        with container.database.read() as session:
            records = session.execute(
                text("SELECT record FROM embeddings WHERE fingerprint = :one"), {"one": DEFAULT.fingerprint}
            ).scalars()
            assert all(embedding_from_bytes(record).orientation.size for record in records)
        assert reembedding.prune() == 3
    assert set(fingerprints(folder)) == {active(folder)} == {DEFAULT.fingerprint}
    assert check(folder / "archive.sqlite3", lock_seconds=1).faults == []
