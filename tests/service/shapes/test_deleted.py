"""Deleting with a time to undo it."""

from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import delete, update

from core.parameters import DEFAULT
from service.client import Client
from service.pipelines import repository as pipelines
from service.shapes.service import purge_old
from service.storage import database
from service.storage.tables import NOT_DELETED, BlobRow, EmbeddingRow, ShapeRow, WordRow
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, module_service, small_file

pytestmark = on_both

DAYS = 3


keeping = module_service(undo_days=DAYS)
"""A service that keeps what was deleted for some days."""


@pytest.fixture
def service(keeping: Running) -> Running:
    """The same, with nothing stored, and nothing deleted."""
    keeping.clear()
    purge_old(keeping.container.database, timedelta(0))
    return keeping


def age(running: Running, days: float) -> None:
    """Have what was deleted have been deleted so long ago."""
    with running.container.database.write() as session:
        session.execute(
            update(ShapeRow).where(~NOT_DELETED).values(deleted_at=datetime.now(UTC) - timedelta(days=days))
        )


def test_a_deletion_for_good_frees_its_room_at_once(service: Running) -> None:
    client = service.client
    shape = service.store(small_file(1), "bird.off")
    assert client.delete(f"/shapes/{shape['id']}", params={"permanent": "true"}).status_code == 204
    assert (service.rows(BlobRow), service.rows(ShapeRow, ~NOT_DELETED)) == (0, 0)
    assert client.get("/deleted").json()["total"] == 0
    assert_problem(client.post(f"/shapes/{shape['id']}/restore"), 404, "shape-not-found")
    kept = service.store(small_file(1), "bird.off")
    assert_problem(client.delete(f"/shapes/{kept['id']}?permanent=maybe"), 422, "bad-request-fields")
    with Client(str(client.base_url)) as own:
        own.delete(kept["id"])
        assert (service.rows(BlobRow), service.rows(ShapeRow, ~NOT_DELETED)) == (1, 1)
        own.restore(kept["id"])
        own.delete(kept["id"], permanent=True)
    assert (service.rows(BlobRow), service.rows(ShapeRow, ~NOT_DELETED)) == (0, 0)


def test_a_deleted_shape_is_gone_until_it_is_restored(service: Running) -> None:
    client = service.client
    other = service.store(small_file(2), name="other.off")
    shape = service.store(small_file(1), "bird.off", tags="b,a", metadata='{"year": 2024}')
    assert client.delete(f"/shapes/{shape['id']}").status_code == 204
    assert_problem(client.get(f"/shapes/{shape['id']}"), 404, "shape-not-found")
    assert client.get("/shapes").json()["total"] == 1
    (gone,) = client.get("/deleted").json()["shapes"]
    told = {key: gone[key] for key in shape if key in gone}
    assert told == {key: shape[key] for key in told}
    deleted, until = (datetime.fromisoformat(gone[key]) for key in ("deleted_at", "gone_at"))
    assert until - deleted == timedelta(days=DAYS)
    restored = client.post(f"/shapes/{shape['id']}/restore")
    assert restored.status_code == 200
    assert {**restored.json(), "updated_at": 0} == {**shape, "updated_at": 0}
    assert client.get(f"/shapes/{shape['id']}/file").content == small_file(1)
    assert [each["id"] for each in client.get("/shapes").json()["shapes"]] == [other["id"], shape["id"]]
    found = client.post("/query", json={"shape_id": shape["id"], "exclude_self": False}).json()["results"]
    assert found[0]["shape"]["id"] == shape["id"]
    assert client.get("/deleted").json()["shapes"] == []
    assert_problem(client.post(f"/shapes/{shape['id']}/restore"), 404, "shape-not-found")


def test_nothing_finds_or_counts_a_deleted_shape(service: Running) -> None:
    """Neither do other shapes on its file, nor a shape of its name, nor a duplicate of it."""
    client, database = service.client, service.container.database
    kept, gone, twin = (
        service.store(small_file(number), name, tags="t", metadata='{"k": 1}')
        for number, name in ((1, "kept.off"), (2, "gone.off"), (2, "twin.off"))
    )
    assert len(client.get("/duplicates").json()["groups"]) == 1
    before = client.post("/query", files={"file": ("x.off", small_file(2))}).json()
    assert (before["stored"], before["compared"]) == (3, 3)
    assert client.delete(f"/shapes/{gone['id']}").status_code == 204
    left = {kept["id"], twin["id"]}
    filters: list[dict[str, str]] = [{}, {"tag": "t"}, {"metadata": "k=1"}, {"area": "0.."}, {"sort": "name"}]
    for listed in filters:
        page = client.get("/shapes", params=listed).json()
        assert ({shape["id"] for shape in page["shapes"]}, page["total"]) == (left, 2)
    for listed in ({}, {"tag": "t"}, {"exhaustive": True}, {"rank_by": "combined"}):
        answer = client.post("/query", files={"file": ("x.off", small_file(2))}, data=listed).json()
        assert {result["shape"]["id"] for result in answer["results"]} == left
        assert (answer["stored"], answer["compared"]) == (2, 2)
    assert client.get("/collections").json()["collections"][0]["shapes"] == 2
    assert client.get("/duplicates").json()["groups"] == []
    address = f"/shapes/{gone['id']}"
    for method, path, body in (
        *(("GET", path, None) for path in ("", "/file", "/embedding", "/thumbnail.png", "/preview.glb")),
        ("GET", "/similar", None),
        ("DELETE", "", None),
        ("PATCH", "", {"name": "n"}),
    ):
        assert_problem(client.request(method, address + path, json=body), 404, "shape-not-found")
    assert_problem(client.post("/query", json={"shape_id": gone["id"]}), 404, "shape-not-found")
    pair = {"first": kept["id"], "second": gone["id"]}
    assert_problem(client.post("/compare", json=pair), 404, "shape-not-found")
    assert client.patch(f"/shapes/{twin['id']}", json={"name": "gone.off"}).status_code == 200
    with database.read() as session:
        assert pipelines.count_embedded(session, DEFAULT.fingerprint) == (2, 2)
    # The file stays for the shape that has it; erased with the last one.
    assert service.rows(BlobRow) == 2
    assert client.delete(f"/shapes/{twin['id']}").status_code == 204
    with database.read() as session:
        assert pipelines.count_embedded(session, DEFAULT.fingerprint) == (1, 1)
    purge_old(database, timedelta(0))
    assert service.rows(BlobRow) == 1
    assert service.rows(EmbeddingRow) == 1


def test_a_restored_shape_is_embedded_by_the_pipeline_that_is_active_by_then(service: Running) -> None:
    shape = service.store(small_file(1), "bird.off")
    service.client.delete(f"/shapes/{shape['id']}")
    with service.container.database.write() as session:
        session.execute(delete(EmbeddingRow))
    restored = service.client.post(f"/shapes/{shape['id']}/restore").json()
    assert restored["embedded"]
    answer = service.client.post("/query", json={"shape_id": shape["id"], "exclude_self": False}).json()
    assert answer["results"][0]["shape"]["id"] == shape["id"]


def test_a_restored_shape_gets_the_tags_of_rules_that_came_meanwhile(service: Running) -> None:
    client = service.client
    shape = service.store(small_file(1), "bird.off", tags="own", metadata='{"material": "Steel"}')["id"]
    client.delete(f"/shapes/{shape}")
    assert client.put("/rules", json={"rules": {"material=steel": ["metal"]}}).json()["changed"] == 0
    assert client.post(f"/shapes/{shape}/restore").json()["tags"] == ["own", "metal"]
    assert client.get("/shapes", params={"q": "metal"}).json()["total"] == 1
    client.put("/rules", json={"rules": {}})


def test_a_damaged_file_is_not_restored(service: Running) -> None:
    shape = service.store(small_file(1))["id"]
    service.client.delete(f"/shapes/{shape}")
    with service.container.database.write() as session:
        session.execute(update(BlobRow).values(data=b"OFF"))
    assert_problem(service.client.post(f"/shapes/{shape}/restore"), 500, "bad-record")
    assert service.client.get("/shapes").json()["total"] == 0


def test_a_shape_that_was_stored_again_is_not_restored_beside_it(service: Running) -> None:
    first = service.store(small_file(1), name="bird.off")
    service.client.delete(f"/shapes/{first['id']}")
    again = service.store(small_file(1), name="bird.off")
    assert again["id"] != first["id"]
    refused = service.client.post(f"/shapes/{first['id']}/restore")
    assert again["id"] in assert_problem(refused, 409, "name-taken")["detail"]
    assert service.client.get("/deleted").json()["total"] == 1
    service.client.patch(f"/shapes/{again['id']}", json={"name": "renamed.off"})
    assert service.client.post(f"/shapes/{first['id']}/restore").json()["name"] == "bird.off"
    assert service.client.get("/shapes").json()["total"] == 2


def test_a_purged_or_too_old_shape_cannot_be_restored(service: Running) -> None:
    with Client(str(service.client.base_url)) as client:
        ids = [service.store(small_file(number), name=f"{number}")["id"] for number in (1, 2)]
        for number in ids:
            client.delete(number)
        assert [shape.id for shape in client.deleted()] == ids
        client.purge(ids[0])
        assert [shape.id for shape in client.deleted()] == [ids[1]]
        for number in (ids[0], "no-such-shape"):
            for answer in (
                service.client.delete(f"/deleted/{number}"),
                service.client.post(f"/shapes/{number}/restore"),
            ):
                assert_problem(answer, 404, "shape-not-found")
        age(service, DAYS - 0.1)
        purge_old(service.container.database, timedelta(days=DAYS))
        assert [shape.id for shape in client.deleted()] == [ids[1]]
        age(service, DAYS + 0.1)
        assert list(client.deleted()) == []
        assert_problem(service.client.post(f"/shapes/{ids[1]}/restore"), 404, "shape-not-found")
        assert service.rows(ShapeRow, ~NOT_DELETED) == 1
        purge_old(service.container.database, timedelta(days=DAYS))
        assert service.rows(ShapeRow, ~NOT_DELETED) == 0


def test_many_deletions_are_purged_batch_by_batch(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "AT_ONCE", 1)
    for number in range(3):
        service.store(small_file(number), f"{number}.off")
    service.clear(permanent=False)
    assert service.rows(BlobRow) == 3
    purge_old(service.container.database, timedelta(0))
    assert [service.rows(table) for table in (BlobRow, EmbeddingRow, WordRow)] == [0, 0, 0]


def test_deleted_shapes_are_listed_in_the_order_of_their_deletion(service: Running) -> None:
    ids = [service.store(small_file(1), name=f"{number}")["id"] for number in range(5)]
    for number in reversed(ids):
        service.client.delete(f"/shapes/{number}")
    seen, cursor = [], {}
    while cursor is not None:
        page = service.client.get("/deleted", params={"limit": 2, **cursor}).json()
        assert (page["total"], page["undo_days"]) == (5, DAYS)
        seen += [shape["id"] for shape in page["shapes"]]
        cursor = {"cursor": page["next_cursor"]} if page["next_cursor"] else None
    assert seen == ids[::-1]
    with Client(str(service.client.base_url)) as client:
        assert client.restore(ids[2]).name == "2"
    assert service.client.get(f"/shapes/{ids[2]}/file").content == small_file(1)


def test_without_days_nothing_is_kept(shared: Running) -> None:
    shared.clear()
    shape = shared.store(small_file(1))
    shared.client.delete(f"/shapes/{shape['id']}")
    assert shared.rows(ShapeRow, ~NOT_DELETED) == 0
    assert shared.client.get("/deleted").json()["shapes"] == []
