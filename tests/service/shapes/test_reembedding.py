"""Going over to another pipeline: nothing is done twice, nothing is lost, and queries change at once."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from core.errors import DegenerateMeshError
from core.parameters import Parameters
from core.pipeline import Pipeline
from service.compute.request_queue import RequestQueue
from service.compute.tasks import Embedded
from service.errors import ClusterUnavailableError, WorkerLostError
from service.search.records import MatchedCandidates
from service.search.scoring import Cascade
from service.shapes import reembedding as reembedding_module
from service.shapes.reembedding import Reembedding, ReembeddingResult, prune_others
from service.storage.database import Database
from tests.service.engines import on_both
from tests.service.pipeline_files import active, embeddings, fingerprints, write_parameters
from tests.service.support import (
    Running,
    assert_problem,
    pipeline_in_use,
    query,
    serving,
    settings_in,
    small_file,
    wait_until,
)

STORED = 4

Hook = Callable[[bytes], None]


class Watched(RequestQueue):
    """The work of a service, which calls something before each embedding."""

    def __init__(self, work: RequestQueue, hook: Hook) -> None:
        self.__dict__ = dict(work.__dict__)
        # Turns are of one event loop.
        self.__post_init__()
        self.embedded: list[bytes] = []
        self._hook = hook

    async def embed(self, data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        await asyncio.to_thread(self._hook, data)
        embedded = await super().embed(data, format, pipeline)
        self.embedded.append(data)
        return embedded


@pytest.fixture
def few(tmp_path: Path) -> Parameters:
    return write_parameters(tmp_path)


@pytest.fixture(scope="module")
def serving_one(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[tuple[Running, Path]]:
    folder = tmp_path_factory.mktemp("reembedding")
    with serving(settings_in(folder)) as running:
        yield running, folder


@pytest.fixture
def stocked(serving_one: tuple[Running, Path]) -> tuple[Running, Path]:
    """A service with shapes that are embedded by its own pipeline alone."""
    running, folder = serving_one
    running.clear()
    go_over(running, running.container.pipelines.wanted)
    for number in range(STORED):
        running.store(small_file(number), f"{number}.off")
    running.store(small_file(0), "again.off")
    assert len(embeddings(folder)) == STORED
    return running, folder


def nothing(_data: bytes) -> None:
    pass


def go_over(
    running: Running, parameters: Parameters, hook: Hook = nothing, *, leave_out: bool = False
) -> tuple[ReembeddingResult, Watched]:
    """Reembed the archive of a running service, as a process beside it would."""
    work, settings = Watched(running.container.queue, hook), running.container.settings
    told: list[tuple[int, int]] = []
    with closing(Database(settings.database_url, lock_seconds=settings.lock_seconds)) as database:
        outcome = asyncio.run(
            Reembedding(database, work, parameters).run(
                at_once=2, leave_out=leave_out, advance=lambda done, total: told.append((done, total))
            )
        )
    assert all(done <= total for done, total in told)
    return outcome, work


@on_both
def test_queries_change_when_all_are_embedded_and_find_what_they_found(
    stocked: tuple[Running, Path], few: Parameters
) -> None:
    running, folder = stocked
    old = pipeline_in_use(running).fingerprint
    seen = set()

    def ask(_data: bytes) -> None:
        answer = query(running.client, small_file(3)).json()
        seen.add((answer["pipeline"], answer["compared"], answer["results"][0]["shape"]["name"]))

    outcome, work = go_over(running, few, ask)
    assert (outcome.made, outcome.refused, outcome.active) == (STORED, [], True)
    assert sorted(work.embedded) == sorted(small_file(number) for number in range(STORED))
    assert seen == {(old, STORED + 1, "3.off")}
    for number in range(STORED):
        answer = query(running.client, small_file(number)).json()
        assert (answer["pipeline"], answer["compared"]) == (few.fingerprint, STORED + 1)
        assert answer["results"][0]["shape"]["sha256"] == sha_of(running, f"{number}.off")
        assert answer["results"][0]["cc"] == pytest.approx(1.0)
    told = running.client.get("/version").json()
    assert (told["pipeline"], told["fingerprint"]) == ("few", few.fingerprint)
    assert (told["pending"]["fingerprint"], told["pending"]["embedded"]) == (old, STORED)
    assert sorted(set(fingerprints(folder))) == sorted({old, few.fingerprint})


def sha_of(running: Running, name: str) -> str:
    (shape,) = running.client.get("/shapes", params={"name": name}).json()["shapes"]
    return shape["sha256"]


def test_finished_embeddings_are_not_computed_again(stocked: tuple[Running, Path], few: Parameters) -> None:
    running, folder = stocked
    old = pipeline_in_use(running).fingerprint
    begun = []

    def stop(data: bytes) -> None:
        begun.append(data)
        if len(begun) > 3:
            raise KeyboardInterrupt

    with pytest.raises((KeyboardInterrupt, asyncio.CancelledError)):
        go_over(running, few, stop)
    kept = [row for row in embeddings(folder) if row[1] == few.fingerprint]
    assert 2 <= len(kept) <= 3
    assert active(folder) == old
    assert query(running.client, small_file(3)).json()["pipeline"] == old

    outcome, work = go_over(running, few)
    assert outcome.made == len(work.embedded) == STORED - len(kept)
    assert outcome.active
    assert set(kept) <= set(embeddings(folder))
    outcome, work = go_over(running, few)
    assert (outcome.made, work.embedded, outcome.active) == (0, [], True)


def test_shapes_stored_or_deleted_meanwhile_are_so_afterwards(
    stocked: tuple[Running, Path], few: Parameters
) -> None:
    running, folder = stocked
    old = pipeline_in_use(running).fingerprint
    (doomed,) = running.client.get("/shapes", params={"name": f"{STORED - 1}.off"}).json()["shapes"]
    first = threading.Lock()

    def meanwhile(_data: bytes) -> None:
        if first.acquire(blocking=False):
            for number in range(3):
                running.store(small_file(10 + number), f"late-{number}.off")
            assert running.client.delete(f"/shapes/{doomed['id']}").status_code == 204

    outcome, _ = go_over(running, few, meanwhile)
    assert outcome.active
    shapes = running.client.get("/shapes").json()["shapes"]
    assert all(shape["embedded"] for shape in shapes)
    assert {shape["name"] for shape in shapes} >= {"late-0.off", "late-1.off", "late-2.off"}
    answer = query(running.client, small_file(12)).json()
    assert (answer["compared"], answer["stored"]) == (len(shapes), len(shapes))
    assert answer["results"][0]["shape"]["name"] == "late-2.off"
    files = len({shape["sha256"] for shape in shapes})
    assert sorted(fingerprints(folder)) == sorted([old] * files + [few.fingerprint] * files)


def test_an_upload_that_began_before_is_embedded_by_the_pipeline_of_its_end(
    stocked: tuple[Running, Path], few: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    running, _ = stocked
    work = running.container.queue
    embed = work.embed
    pipelines = []

    async def slow(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        embedded = await embed(data, format, pipeline)
        pipelines.append(pipeline.fingerprint)
        if len(pipelines) == 1:
            with monkeypatch.context() as patch:
                patch.setattr(work, "embed", embed)
                await asyncio.to_thread(go_over, running, few)
        return embedded

    old = pipeline_in_use(running).fingerprint
    with monkeypatch.context() as patch:
        patch.setattr(work, "embed", slow)
        shape = running.store(small_file(20), "late.off")
    assert pipelines == [old, few.fingerprint]
    assert shape["embedded"] is True
    assert query(running.client, small_file(20)).json()["results"][0]["shape"]["id"] == shape["id"]


@pytest.mark.parametrize("by", ["file", "id"])
def test_a_query_that_loses_its_embeddings_is_answered_by_the_new_ones(
    stocked: tuple[Running, Path], few: Parameters, monkeypatch: pytest.MonkeyPatch, by: str
) -> None:
    running, folder = stocked
    score = Cascade.score
    changed: list[ReembeddingResult] = []

    async def late(*given: Any) -> MatchedCandidates:
        if not changed:
            changed.append((await asyncio.to_thread(go_over, running, few))[0])
            await asyncio.to_thread(prune_others, running.container.database, few.fingerprint)
        return await score(*given)

    (shape,) = running.client.get("/shapes", params={"name": "2.off"}).json()["shapes"]
    with monkeypatch.context() as patch:
        patch.setattr(Cascade, "score", late)
        if by == "file":
            answer = query(running.client, small_file(2))
        else:
            answer = running.client.post("/query", json={"shape_id": shape["id"], "exclude_self": False})
    assert answer.status_code == 200, answer.text
    assert answer.json()["pipeline"] == few.fingerprint
    assert answer.json()["compared"] == STORED + 1
    assert answer.json()["results"][0]["shape"]["id"] == shape["id"]
    assert set(fingerprints(folder)) == {few.fingerprint}


def test_pruned_and_gone_back_to_all_is_found_again(stocked: tuple[Running, Path], few: Parameters) -> None:
    running, folder = stocked
    wanted = running.container.pipelines.wanted
    assert query(running.client, small_file(1)).json()["compared"] == STORED + 1
    for parameters in (few, wanted):
        outcome, _ = go_over(running, parameters)
        assert (outcome.made, outcome.active) == (STORED, True)
        assert prune_others(running.container.database, parameters.fingerprint) == STORED
        assert set(fingerprints(folder)) == {parameters.fingerprint}
        assert prune_others(running.container.database, parameters.fingerprint) == 0
    # Not asked in between, the service's index is of the same pipeline as before, and of none of its rows.
    answer = query(running.client, small_file(1)).json()
    assert (answer["compared"], answer["pipeline"]) == (STORED + 1, wanted.fingerprint)


@on_both
@pytest.mark.parametrize("error", [DegenerateMeshError("too thin"), WorkerLostError("it died")])
def test_a_file_that_cannot_be_embedded_keeps_the_archive_as_it_is_unless_left_out(
    stocked: tuple[Running, Path], few: Parameters, error: Exception
) -> None:
    running, folder = stocked
    old = pipeline_in_use(running).fingerprint
    tries = []

    def refuse(data: bytes) -> None:
        if data == small_file(0):
            tries.append(data)
            raise error

    outcome, _ = go_over(running, few, refuse)
    assert (outcome.made, outcome.active) == (STORED - 1, False)
    assert outcome.refused == [("0.off", str(error)), ("again.off", str(error))]
    assert len(tries) == (2 if isinstance(error, WorkerLostError) else 1)
    assert query(running.client, small_file(0)).json()["pipeline"] == old

    outcome, _ = go_over(running, few, refuse, leave_out=True)
    assert (outcome.made, outcome.active, len(outcome.refused)) == (0, True, 2)
    answer = query(running.client, small_file(0)).json()
    assert (answer["compared"], answer["stored"]) == (STORED - 1, STORED + 1)
    (shape,) = running.client.get("/shapes", params={"name": "0.off"}).json()["shapes"]
    assert shape["embedded"] is False
    assert_problem(running.client.post("/query", json={"shape_id": shape["id"]}), 409, "not-embedded")

    assert prune_others(running.container.database, few.fingerprint) == STORED - 1
    assert sorted(fingerprints(folder)) == sorted([old] + [few.fingerprint] * (STORED - 1))


def test_a_cluster_that_is_away_is_waited_for(
    stocked: tuple[Running, Path], few: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reembedding_module, "CLUSTER_SECONDS", 0.01)
    away: list[bytes] = []

    def go_away(data: bytes) -> None:
        if len(away) < 20:
            away.append(data)
            raise ClusterUnavailableError("the scheduler was lost")

    outcome, work = go_over(stocked[0], few, go_away)
    assert (outcome.made, outcome.refused, outcome.active) == (STORED, [], True)
    assert (len(away), len(work.embedded)) == (20, STORED)


def test_a_shape_without_an_embedding_of_the_pipeline_in_use_gets_it(stocked: tuple[Running, Path]) -> None:
    running, _ = stocked
    assert query(running.client, small_file(1)).json()["compared"] == STORED + 1
    with running.container.database.write() as session:
        session.execute(text("DELETE FROM embeddings WHERE number = (SELECT min(number) FROM embeddings)"))
    outcome, _ = go_over(running, running.container.pipelines.wanted)
    assert (outcome.made, outcome.active) == (1, True)
    answer = query(running.client, small_file(0)).json()
    assert answer["compared"] == STORED + 1
    assert answer["results"][0]["shape"]["name"] == "0.off"


def test_a_running_service_says_when_a_newer_one_has_taken_the_archive_over(
    stocked: tuple[Running, Path],
) -> None:
    running, _ = stocked
    old = pipeline_in_use(running).fingerprint
    (shape, *_) = running.client.get("/shapes").json()["shapes"]

    def search_by(fingerprint: str) -> None:
        with running.container.database.write() as session:
            columns = "fingerprint, method, parameters, checksum"
            newer = f"INSERT INTO pipelines ({columns}) VALUES ('0123456789abcdef', 99, '{{}}', '')"
            session.execute(text(f"{newer} ON CONFLICT DO NOTHING"))
            session.execute(text("UPDATE archive SET fingerprint = :value"), {"value": fingerprint})

    search_by("0123456789abcdef")
    client = running.client
    for answer in (
        query(client, small_file(0)),
        client.post("/query", json={"shape_id": shape["id"]}),
        client.post("/compare", json={"first": shape["id"], "second": shape["id"]}),
        client.get("/version"),
        client.post("/shapes", files={"file": ("new.off", small_file(9))}),
    ):
        problem = assert_problem(answer, 503, "pipeline-unavailable")
        assert "version 99 of the method" in problem["detail"]
    assert "version 99" in assert_problem(client.get("/readyz"), 503, "not-ready")["detail"]
    assert client.get(f"/shapes/{shape['id']}").json() == {**shape, "embedded": False}
    assert client.get(f"/shapes/{shape['id']}/file").content == small_file(0)
    search_by(old)
    wait_until(lambda: client.get("/readyz").status_code == 200, seconds=60)
    assert query(client, small_file(0)).json()["compared"] == STORED + 1
