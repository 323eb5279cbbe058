"""An archive whose embeddings have no orientation: it answers as before, until `isoshape reembed` adds it."""

from pathlib import Path
from typing import Any

import pytest

from core.parameters import DEFAULT
from core.serialization import embedding_from_bytes
from tests.core.parameters.earlier_parameters import BEFORE_ORIENTATION
from tests.service.pipeline_files import fingerprints
from tests.service.storage.archives.before_views.make import answers, queries
from tests.service.storage.earlier_archives import EarlierArchive, assert_sound, records
from tests.service.support import serving, settings_in, small_file

ARCHIVE = EarlierArchive(
    Path(__file__).with_name("archives") / "before_orientation" / "without_orientation.sqlite3"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ARCHIVE.copy_to(tmp_path)
    return tmp_path


def test_its_fingerprint_keeps_its_meaning() -> None:
    assert BEFORE_ORIENTATION.fingerprint == ARCHIVE.fingerprint
    assert DEFAULT.fingerprint != ARCHIVE.fingerprint


def test_it_answers_as_before_and_says_what_reembed_adds(folder: Path) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        ARCHIVE.assert_answers_as_before(running)
        pending = running.client.get("/version").json()["pending"]
        assert (pending["fingerprint"], pending["embedded"], pending["files"]) == (DEFAULT.fingerprint, 0, 3)
        assert "orientation" in pending["message"]
        assert "views" not in pending["message"]
        # New shapes join the pipeline of before.
        running.client.post("/shapes", files={"file": ("new.off", queries()["small"])}).raise_for_status()
    assert set(fingerprints(folder)) == {ARCHIVE.fingerprint}


@pytest.fixture
def without_orientation(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answers of an archive of the same shapes, which this version embeds without orientation."""
    folder = tmp_path_factory.mktemp("without")
    pipeline = folder / "without.json"
    pipeline.write_text('{"orientation": false}')
    with serving(settings_in(folder, pipeline=str(pipeline))) as running:
        for number in range(3):
            running.store(small_file(number), f"{number}.off")
        return answers(running)


def test_reembed_adds_orientation_and_changes_no_score(
    folder: Path, without_orientation: dict[str, Any]
) -> None:
    with serving(settings_in(folder, workers=1)) as running:
        ARCHIVE.reembed(running)
        assert running.client.get("/version").json()["fingerprint"] == DEFAULT.fingerprint
        now = answers(running)
        assert now["answers"] == without_orientation["answers"]
        assert now["compared"] == without_orientation["compared"]
        assert all(embedding_from_bytes(record).orientation.size for record in records(running))
    assert_sound(folder)
