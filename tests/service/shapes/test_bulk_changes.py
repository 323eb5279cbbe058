"""Changes to all shapes that pass a filter."""

from typing import Any

from service.shapes.bulk_schemas import BulkChanged
from service.shapes.fields import TAGS
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


def patched(service: Running, **change: Any) -> BulkChanged:
    answer = service.client.patch("/shapes", json=change)
    assert answer.status_code == 200, answer.text
    return BulkChanged.model_validate(answer.json())


def told(service: Running, **wanted: str) -> dict[str, tuple[list[str], dict[str, Any]]]:
    shapes = service.client.get("/shapes", params=wanted).json()["shapes"]
    return {shape["name"]: (shape["tags"], shape["metadata"]) for shape in shapes}


def test_tags_and_metadata_of_all_that_match_change_after_a_dry_run(service: Running) -> None:
    full = [f"tag{number}" for number in range(TAGS - 1)]
    service.store(
        small_file(0), name="bolt a.off", tags="red,old", metadata='{"kept": 1, "gone": 2, "bit": 1}'
    )
    service.store(small_file(1), name="bolt b.off", tags="new")
    service.store(small_file(2), name="bolt c.off", tags=",".join([*full, "old"]))
    service.store(small_file(3), name="nut.off", tags="old")
    change = {"q": "bolt", "add_tags": ["new", "m8"], "remove_tags": ["old"]}
    change |= {"set_metadata": {"bit": True}, "remove_metadata": ["gone"]}
    before = told(service)
    tried = patched(service, **change)
    assert (tried.matched, tried.changed, [each.name for each in tried.refused]) == (3, 2, ["bolt c.off"])
    assert told(service) == before
    assert patched(service, **change, dry_run=False) == tried
    assert told(service) == {
        **before,
        "bolt a.off": (["red", "new", "m8"], {"kept": 1, "bit": True}),
        "bolt b.off": (["new", "m8"], {"bit": True}),
    }
    assert told(service)["bolt a.off"][1]["bit"] is True
    assert set(told(service, q="m8")) == {"bolt a.off", "bolt b.off"}
    again = patched(service, **change, dry_run=False)
    assert (again.matched, again.changed) == (3, 0)


def test_shapes_move_unless_their_name_is_taken(service: Running) -> None:
    service.client.put("/collections/bulk")
    service.store(small_file(0), name="a.off", tags="move")
    service.store(small_file(1), name="b.off", tags="move")
    there = {"params": {"collection": "bulk"}}
    taken = {"files": {"file": ("a.off", small_file(0))}}
    assert service.client.post("/shapes", **there, **taken).status_code == 201
    moved = patched(service, tag=["move"], collection="bulk", dry_run=False)
    assert (moved.matched, moved.changed, [each.name for each in moved.refused]) == (2, 1, ["a.off"])
    assert (set(told(service)), set(told(service, collection="bulk"))) == ({"a.off"}, {"a.off", "b.off"})
    missing = service.client.patch("/shapes", json={"collection": "nowhere"})
    assert_problem(missing, 404, "collection-not-found")
    for shape in service.client.get("/shapes", **there).json()["shapes"]:
        service.client.delete(f"/shapes/{shape['id']}", **there)
    assert service.client.delete("/collections/bulk").status_code == 204
