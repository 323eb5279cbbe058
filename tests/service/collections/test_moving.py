"""Moving a shape to another collection: all of it goes, and nothing of it stays."""

from typing import Any

import httpx

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.dense.solids import plate
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, module_service, small_file, wait_until, working_in

pytestmark = on_both

running = module_service(undo_days=1)

COPIES = 3


def read(own: Running, shape_id: str) -> dict[str, Any]:
    """The record of a shape."""
    return dict(own.client.get(f"/shapes/{shape_id}").json())


def found(own: Running, shape_id: str) -> set[str]:
    """The shapes that a query of a stored one finds in its collection."""
    answer = own.client.post("/query", json={"shape_id": shape_id, "top_k": 100}).json()
    return {result["shape"]["id"] for result in answer["results"]}


def groups(own: Running) -> list[list[str]]:
    """The ids of each group of duplicates, once all shapes have been compared."""
    answer: dict[str, Any] = {}

    def compared() -> bool:
        answer.update(own.client.get("/duplicates").json())
        return bool(answer["unjudged"] == 0)

    wait_until(compared, seconds=120)
    return [[member["shape"]["id"] for member in group] for group in answer["groups"]]


def test_a_shape_moves_whole(running: Running) -> None:
    part = plate([(4, 4)])
    data = [write_mesh(Mesh(part.vertices + k, part.faces), "ply") for k in range(COPIES)]
    with working_in(running, "one") as one, working_in(running, "two") as two:
        shapes = [one.store(data[k], f"{k}.ply", tags="a,b", metadata='{"k": 1}') for k in range(COPIES)]
        ids = [shape["id"] for shape in shapes]
        before = read(one, ids[1])
        other = two.store(small_file(9), "other.off")
        one.client.get("/duplicates")
        moved = one.client.patch(f"/shapes/{ids[1]}", json={"collection": "two", "tags": ["c"]})
        assert moved.status_code == 200, moved.text
        new = moved.json()
        assert new.pop("updated_at") >= before.pop("updated_at")
        assert new == before | {"tags": ["c"]}
        # Where it was, it is gone from every list.
        assert_problem(one.client.get(f"/shapes/{ids[1]}"), 404, "shape-not-found")
        assert found(one, ids[0]) == {ids[2]}
        assert groups(one) == [[ids[0], ids[2]]]
        assert one.client.get("/deleted").json()["total"] == 0
        # Where it is, it is found by all that belongs to it.
        assert two.client.get(f"/shapes/{ids[1]}/file").content == data[1]
        assert found(two, ids[1]) == {other["id"]}
        assert groups(two) == []
        assert [shape["id"] for shape in two.client.get("/shapes?tag=c&metadata=k=1").json()["shapes"]] == [
            ids[1]
        ]
        # And back again, which is the same shape.
        back = two.client.patch(f"/shapes/{ids[1]}", json={"collection": "one"})
        assert back.json()["created_at"] == shapes[1]["created_at"]
        assert found(one, ids[0]) == {ids[1], ids[2]}
        assert [sorted(group) for group in groups(one)] == [sorted(ids)]
        for own in (one, two):
            own.clear()


def test_a_move_that_cannot_be_changes_nothing(running: Running) -> None:
    with working_in(running, "one") as one, working_in(running, "two") as two:
        shape = read(one, one.store(small_file(1), "a.off")["id"])
        same = two.store(small_file(1), "a.off")

        def move(**changes: str) -> httpx.Response:
            return one.client.patch(f"/shapes/{shape['id']}", json=changes)

        assert_problem(move(collection="two", name="a.off"), 409, "name-taken")
        assert_problem(move(collection="two"), 409, "name-taken")
        assert_problem(move(collection="never-made"), 404, "collection-not-found")
        assert read(one, shape["id"]) == shape
        # To where it is already.
        stays = one.client.patch(f"/shapes/{shape['id']}", json={"collection": "one"})
        assert stays.json() == shape
        # Under another name there is room for both.
        renamed = one.client.patch(f"/shapes/{shape['id']}", json={"collection": "two", "name": "b.off"})
        assert renamed.json()["name"] == "b.off"
        listed = two.client.get("/shapes").json()["shapes"]
        assert {each["id"] for each in listed} == {shape["id"], same["id"]}
        assert two.client.get("/shapes/" + shape["id"] + "/file").content == small_file(1)
        for own in (one, two):
            own.clear()
