"""Archives that earlier versions wrote (`archives/*/make.py`), and the answers that those versions gave."""

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

from sqlalchemy import text

from core.parameters import DEFAULT
from service.shapes.reembedding import Reembedding, prune_others
from service.storage.checking import check
from tests.service.pipeline_files import active, fingerprints
from tests.service.storage.archives.before_views.make import answers, queries
from tests.service.support import Running, query


class EarlierArchive:
    """An archive of three shapes whose pipeline was the default of an earlier version.

    Args:
        path: Its file; the version's answers are beside it, as JSON.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.before: dict[str, Any] = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        self.fingerprint: str = self.before["version"]["fingerprint"]

    def copy_to(self, folder: Path) -> None:
        shutil.copy(self.path, folder / "archive.sqlite3")

    def assert_answers_as_before(self, running: Running) -> None:
        now = answers(running)
        assert now["answers"] == self.before["answers"]
        assert now["compared"] == self.before["compared"]

    def reembed(self, running: Running) -> list[dict[str, Any]]:
        """Reembeds a copy while it is served; the answers of a query in the meantime."""
        container = running.container
        reembedding = Reembedding(container.database, container.queue, DEFAULT)
        meantime: list[dict[str, Any]] = []

        def ask(_done: int, _total: int) -> None:
            meantime.append(query(running.client, queries()["small"], rank_by="combined").json())

        outcome = asyncio.run(reembedding.run(at_once=1, leave_out=False, advance=ask))
        assert (outcome.made, outcome.refused, outcome.active) == (3, [], True)
        assert {answer["pipeline"] for answer in meantime} == {self.fingerprint}
        assert running.client.get("/version").json()["pending"] is None
        assert prune_others(container.database, DEFAULT.fingerprint) == 3
        return meantime


def records(running: Running) -> list[bytes]:
    """The stored records of the default pipeline."""
    with running.container.database.read() as session:
        statement = text("SELECT record FROM embeddings WHERE fingerprint = :one")
        return list(session.execute(statement, {"one": DEFAULT.fingerprint}).scalars())


def assert_sound(folder: Path) -> None:
    """The archive of a folder holds embeddings of the default pipeline alone, and no faults."""
    assert set(fingerprints(folder)) == {active(folder)} == {DEFAULT.fingerprint}
    assert check(folder / "archive.sqlite3", lock_seconds=1).faults == []
