"""Collections over HTTP: making, naming, listing and deleting them."""

from datetime import UTC, datetime, timedelta
from urllib.parse import quote

import httpx
import pytest
from sqlalchemy import select, update

from service.collection import is_name
from service.collections.endpoints import HEADER, PARAMETER
from service.storage.tables import (
    NOT_DELETED,
    BlobRow,
    CollectionRow,
    EmbeddingRow,
    IdempotencyKeyRow,
    JobRow,
    ShapeRow,
)
from tests.service.engines import on_both
from tests.service.jobs.support import ended, pack
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    query,
    small_file,
    upload,
    working_in,
)

pytestmark = on_both


running = module_service(undo_days=1)


def names(client: httpx.Client) -> dict[str, int]:
    """How many shapes each collection has."""
    answer = client.get("/collections")
    assert answer.status_code == 200, answer.text
    return {one["name"]: one["shapes"] for one in answer.json()["collections"]}


def test_a_collection_is_made_once_and_listed_with_its_shapes(running: Running) -> None:
    made = running.client.put("/collections/z-9_a")
    again = running.client.put("/collections/z-9_a")
    assert (made.status_code, again.status_code) == (201, 200)
    assert made.json() == again.json()
    with working_in(running, "z-9_a") as own:
        for number in range(2):
            own.store(small_file(number), f"{number}.off")
    running.store(small_file(0))
    found = names(running.client)
    assert (found["z-9_a"], found["default"]) == (2, 1)
    assert list(found) == sorted(found)
    assert running.client.put("/collections/z-9_a").json()["shapes"] == 2
    assert running.client.get("/shapes").json()["total"] == 1
    running.clear()


@pytest.mark.parametrize("name", ["A", "-a", "_", "a" * 65, "a b", "\u00e4", "a+b", "a:b", "a\n", "a.b"])
def test_other_names_are_refused(running: Running, name: str) -> None:
    assert not is_name(name)
    assert_problem(running.client.put(f"/collections/{quote(name)}"), 422, "bad-request-fields")
    assert_problem(running.client.get("/shapes", params={PARAMETER: name}), 404, "collection-not-found")


def test_a_name_is_never_made_by_naming_it(running: Running) -> None:
    before = names(running.client)
    for named in ({"headers": {HEADER: "misspelt"}}, {"params": {PARAMETER: "misspelt"}}):
        answer = running.client.post("/shapes", files={"file": ("a.off", small_file(0))}, **named)  # type: ignore[arg-type]
        assert_problem(answer, 404, "collection-not-found")
    assert names(running.client) == before


def test_header_and_parameter_must_not_differ(running: Running) -> None:
    running.client.put("/collections/a")
    for values, status in (("default", 422), ("a", 200)):
        answer = running.client.get("/shapes", params={PARAMETER: "a"}, headers={HEADER: values})
        assert answer.status_code == status
    twice = [(HEADER, "a"), (HEADER, "default")]
    assert_problem(running.client.get("/shapes", headers=twice), 422, "bad-request-fields")
    both = running.client.get(f"/shapes?{PARAMETER}=a&{PARAMETER}=a")
    assert_problem(both, 422, "bad-request-fields")
    empty = running.client.get("/shapes", params={PARAMETER: ""})
    assert_problem(empty, 404, "collection-not-found")
    # The options of a query are no place to name it.
    wrong = running.client.post("/query", json={"shape_id": "x", PARAMETER: "a"})
    assert_problem(wrong, 422, "bad-request-fields")
    assert_problem(query(running.client, small_file(0), collection="a"), 422, "bad-request-fields")


def test_the_same_bytes_are_kept_once_whatever_the_collection(running: Running) -> None:
    with working_in(running, "one") as one, working_in(running, "two") as two:
        first, second = one.store(small_file(3), "same.off"), two.store(small_file(3), "same.off")
        assert first["id"] != second["id"]
        assert one.store(small_file(3), "same.off") == first
        with running.container.database.read() as session:
            blobs = session.scalars(select(BlobRow.number).where(BlobRow.sha256 == first["sha256"])).all()
            embeddings = select(EmbeddingRow.number).where(EmbeddingRow.blob_number.in_(blobs))
            assert (len(blobs), len(session.scalars(embeddings).all())) == (1, 1)
        # A name is taken in one collection only.
        other = two.store(small_file(3), "other.off")
        taken = two.client.patch(f"/shapes/{other['id']}", json={"name": "same.off"})
        assert_problem(taken, 409, "name-taken")
        renamed = one.client.patch(f"/shapes/{first['id']}", json={"name": "other.off"})
        assert renamed.status_code == 200
        one.clear()
        answer = two.client.post("/query", json={"shape_id": second["id"]}).json()
        assert [result["shape"]["id"] for result in answer["results"]] == [other["id"]]
        assert two.client.get(f"/shapes/{second['id']}/file").content == small_file(3)
        two.clear()


def test_an_idempotency_key_belongs_to_a_collection(running: Running) -> None:
    key = {"idempotency-key": '"one-key"'}
    with working_in(running, "keys-a") as one, working_in(running, "keys-b") as two:
        sent = {"files": {"file": ("a.off", small_file(1))}, "headers": key}
        answers = [own.client.post("/shapes", **sent) for own in (one, two, one)]  # type: ignore[arg-type]
        assert [answer.status_code for answer in answers] == [201, 201, 201]
        assert answers[0].json()["id"] == answers[2].json()["id"] != answers[1].json()["id"]
        assert answers[0].headers["location"] == answers[2].headers["location"]
        assert "idempotency-replayed" in answers[2].headers
        location = answers[1].headers["location"]
        assert location.endswith(f"?{PARAMETER}=keys-b")
        told = {"created": True, "changed": []}
        assert running.client.get(location).json() | told == answers[1].json()
        for own in (one, two):
            own.clear()


def test_only_an_empty_collection_is_deleted(running: Running) -> None:
    client = running.client
    with working_in(running, "short") as own:
        shape = own.store(small_file(4), "four.off")
        archive = {"file": ("a.zip", pack({"5.off": small_file(5)}))}
        job = ended(own.client, own.client.post("/jobs", files=archive).json()["id"])
        assert (
            "has shapes"
            in assert_problem(client.delete("/collections/short"), 409, "collection-not-empty")["detail"]
        )
        upload(own.client, small_file(6), "six.off")
        own.clear(permanent=False)
        # The shapes can still be restored.
        told = assert_problem(client.delete("/collections/short"), 409, "collection-not-empty")
        assert "restored" in told["detail"]
        with running.container.database.write() as session:
            session.execute(
                update(ShapeRow).where(~NOT_DELETED).values(deleted_at=datetime.now(UTC) - timedelta(days=2))
            )
            session.execute(update(JobRow).where(JobRow.id == job["id"]).values(ended_at=None))
        told = assert_problem(client.delete("/collections/short"), 409, "collection-not-empty")
        assert "job" in told["detail"]
        with running.container.database.write() as session:
            session.execute(update(JobRow).where(JobRow.id == job["id"]).values(ended_at=datetime.now(UTC)))
        assert client.delete("/collections/short").status_code == 204
        assert_problem(own.client.get("/shapes"), 404, "collection-not-found")
        assert_problem(own.client.get(f"/shapes/{shape['id']}"), 404, "collection-not-found")
    assert_problem(client.delete("/collections/short"), 404, "collection-not-found")
    assert_problem(client.delete("/collections/default"), 409, "collection-not-empty")
    assert "short" not in names(client)
    with running.container.database.read() as session:
        numbers = session.scalars(select(CollectionRow.number)).all()
        for row in (JobRow, ShapeRow, IdempotencyKeyRow):
            assert set(session.scalars(select(row.collection_number))) <= set(numbers)


def test_an_upload_to_a_deleted_collection_is_refused(running: Running) -> None:
    with working_in(running, "gone") as own:
        gate = running.container.queue.embed

        async def slow(*arguments: object) -> object:
            made = await gate(*arguments)  # type: ignore[arg-type]
            with running.container.database.write() as session:
                session.query(CollectionRow).where(CollectionRow.name == "gone").delete()
            return made

        running.container.queue.embed = slow  # type: ignore[method-assign, assignment]
        try:
            answer = upload(own.client, small_file(50), "late.off")
        finally:
            running.container.queue.embed = gate  # type: ignore[method-assign]
        assert_problem(answer, 404, "collection-not-found")
    assert running.client.get("/shapes", params={"name": "late"}).json()["total"] == 0
