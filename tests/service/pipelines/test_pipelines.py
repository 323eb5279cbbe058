"""One archive under several pipelines, and many clients at a time."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Executable, delete, select, text, update

from core.parameters import DEFAULT, PAPER, Parameters
from service.collection import DEFAULT_COLLECTION
from service.errors import REEMBED, PipelineUnavailableError
from service.pipelines import repository
from service.pipelines.active import Pipelines, begin
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.shapes.records import NewShape
from service.storage.database import Database, migrate
from service.storage.tables import EmbeddingRow, PipelineRow
from tests.service.engines import on_both, url_in, url_of
from tests.service.pipeline_files import active, fingerprints, write_parameters
from tests.service.support import Running, assert_problem, query, serving, settings_in, small_file, upload


@contextmanager
def another(service: Running, **settings: Any) -> Iterator[Running]:
    """One more service on the archive of the shared one."""
    url = url_of(service.container.database)
    with serving(
        service.container.settings.model_copy(update={"database_url": url, "workers": 1, **settings})
    ) as other:
        yield other


@on_both
def test_an_archive_of_another_pipeline_is_served_as_it_is(service: Running) -> None:
    first = service.store(small_file(0), name="first", tags="old")
    second = service.store(small_file(1), name="second")
    before = service.client.get("/version").json()
    assert before["pending"] is None
    by_file = query(service.client, small_file(0)).json()["results"]
    by_id = service.client.post("/query", json={"shape_id": first["id"]}).json()["results"]
    with another(service, pipeline="paper") as running:
        client = running.client
        assert client.get("/version").json() == {
            **before,
            "pending": {
                "name": "paper",
                "fingerprint": PAPER.fingerprint,
                "embedded": 0,
                "files": 2,
                "message": REEMBED,
            },
        }
        for shape in (first, second):
            assert client.get(f"/shapes/{shape['id']}").json() == shape
        assert query(client, small_file(0)).json()["results"] == by_file
        assert client.post("/query", json={"shape_id": first["id"]}).json()["results"] == by_id
        third = running.store(small_file(2), name="third")
        answer = query(client, small_file(2)).json()
        assert answer["results"][0]["shape"]["id"] == third["id"]
        assert (answer["pipeline"], answer["compared"]) == (before["fingerprint"], 3)
    with service.container.database.read() as session:
        assert session.scalars(select(EmbeddingRow.fingerprint)).all() == [before["fingerprint"]] * 3


def test_an_empty_archive_takes_up_the_pipeline_that_the_settings_name(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path)) as running:
        shape = running.store(small_file(0))
        assert running.client.delete(f"/shapes/{shape['id']}").status_code == 204
    assert active(tmp_path) == DEFAULT.fingerprint
    with serving(settings_in(tmp_path, pipeline="paper")) as running:
        told = running.client.get("/version").json()
        assert (told["pipeline"], told["pending"]) == ("paper", None)
        running.store(small_file(0))
    assert fingerprints(tmp_path) == [PAPER.fingerprint]


def test_a_shape_without_an_embedding_of_the_pipeline_in_use_is_said(service: Running) -> None:
    lost, kept = (service.store(small_file(number), f"{number}.off") for number in range(2))
    with service.container.database.write() as session:
        session.execute(text("DELETE FROM embeddings WHERE number = (SELECT min(number) FROM embeddings)"))
    with another(service) as running:
        client = running.client
        assert client.get(f"/shapes/{lost['id']}").json() == {**lost, "embedded": False}
        assert_problem(client.get(f"/shapes/{lost['id']}/embedding"), 409, "not-embedded")
        assert_problem(client.post("/query", json={"shape_id": lost["id"]}), 409, "not-embedded")
        pair = {"first": lost["id"], "second": kept["id"]}
        problem = assert_problem(client.post("/compare", json=pair), 409, "not-embedded")
        assert "isoshape reembed" in problem["detail"]
        answer = query(client, small_file(0)).json()
        assert (answer["compared"], answer["stored"]) == (1, 2)
        again = upload(client, small_file(0), "0.off", tags="new")
        told = {"created": False, "changed": ["tags"]}
        assert again.status_code == 200
        assert again.json() | {"tags": [], "updated_at": ""} == lost | told | {"updated_at": ""}
        assert again.json()["tags"] == ["new"]
        answer = query(client, small_file(0)).json()
        assert (answer["compared"], answer["stored"]) == (2, 2)
        assert answer["results"][0]["shape"]["id"] == lost["id"]


def archive_of(parameters: Parameters, folder: Path) -> Database:
    """A folder's archive, of one shape, which is searched by a pipeline."""
    database = Database(url_in(folder), lock_seconds=1)
    migrate(database)
    with database.write() as session:
        repository.keep(session, parameters)
        repository.activate(session, parameters.fingerprint)
        new = NewShape(b"x", "off", DEFAULT_COLLECTION.number, name="x", tags=(), metadata={})
        shapes_repository.add_shape(session, file_repository.add_blob(session, b"x", new.sha256), new, {})
    return database


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda few: update(PipelineRow).values(method=0), "version 0 of the method"),
        (
            lambda few: update(PipelineRow).values(parameters={**few, "spectral": {"dimensions": 9}}),
            "does not have",
        ),
        (lambda few: update(PipelineRow).values(parameters={**few, "newer": 1}), "does not have"),
        (lambda few: delete(PipelineRow), "whose parameters it does not hold"),
    ],
)
def test_an_archive_of_an_unknown_pipeline_is_refused_at_the_start(
    tmp_path: Path, change: Callable[[dict[str, Any]], Executable], said: str
) -> None:
    few = write_parameters(tmp_path)
    database = archive_of(few, tmp_path)
    with database.write() as session:
        session.execute(change(few.model_dump(mode="json")))
    with pytest.raises(PipelineUnavailableError, match=said) as refused:
        begin(Pipelines(DEFAULT), database)
    assert "isoshape reembed" in str(refused.value)
    database.close()


@on_both
def test_many_uploads_of_one_file_make_one_shape(service: Running) -> None:
    with ThreadPoolExecutor(8) as clients:
        answers = list(clients.map(lambda _: upload(service.client, small_file(0), "same.off"), range(8)))
    assert sorted(answer.status_code for answer in answers) == [200] * 7 + [201]
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert query(service.client, small_file(0)).json()["stored"] == 1


@on_both
def test_uploads_queries_and_deletions_at_a_time_agree_in_the_end(service: Running) -> None:
    kept = [service.store(small_file(number), f"kept-{number}.off")["id"] for number in range(3)]

    def come_and_go(number: int) -> None:
        shape = service.store(small_file(number), f"{number}.off")
        assert service.client.delete(f"/shapes/{shape['id']}").status_code == 204

    def ask(_: int) -> None:
        answer = query(service.client, small_file(0), top_k=100)
        assert answer.status_code == 200, answer.text
        body = answer.json()
        assert set(kept) <= {result["shape"]["id"] for result in body["results"]}
        assert body["results"][0]["shape"]["id"] == kept[0]

    with ThreadPoolExecutor(6) as clients:
        coming = [clients.submit(come_and_go, number) for number in range(10, 22)]
        asking = [clients.submit(ask, i) for i in range(12)]
        for each in coming + asking:
            each.result()
    answer = query(service.client, small_file(0), top_k=100).json()
    assert {result["shape"]["id"] for result in answer["results"]} == set(kept)
    assert answer["compared"] == answer["stored"] == 3
