"""Decisions on near-identical shapes: they last, and follow the files; merges, which can be undone."""

import csv
import io
import json
from datetime import timedelta
from itertools import combinations
from typing import Any

import pytest
from sqlalchemy import delete

from service.client import Client
from service.collection import DEFAULT_COLLECTION
from service.duplicates import merges
from service.duplicates.decision_schemas import Rule
from service.duplicates.groups import undecided
from service.duplicates.records import Decision, Pair, pair_of
from service.shapes.service import purge_old
from service.storage.tables import DuplicateDecisionRow, DuplicateMergeRow
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, module_service, small_file

pytestmark = on_both

keeping = module_service(undo_days=3)
"""A service that keeps deleted shapes."""

AGAIN = b"# written again\n"


@pytest.fixture
def service(keeping: Running) -> Running:
    """The same, holding nothing."""
    keeping.clear()
    purge_old(keeping.container.database, timedelta(0))
    with keeping.container.database.write() as session:
        session.execute(delete(DuplicateDecisionRow))
        session.execute(delete(DuplicateMergeRow))
    return keeping


@pytest.fixture
def copies(service: Running) -> list[str]:
    """The ids of three shapes of one form, two of them with one file, and of another."""
    whole = small_file(0)
    names = {"one.off": whole, "two.off": whole, "three.off": whole + AGAIN, "other.off": small_file(3)}
    return [
        service.store(data, name, tags=f"all,{name[:3]}", metadata=json.dumps({"from": name, name: 1}))["id"]
        for name, data in names.items()
    ]


def groups(service: Running, **wanted: Any) -> list[set[str]]:
    answer = service.client.get("/duplicates", params=wanted).json()
    return [{one["shape"]["id"] for one in group} for group in answer["groups"]]


def decide(service: Running, shapes: list[str], decision: str, **fields: str) -> dict[str, Any]:
    body = {"shapes": shapes, "decision": decision, **fields}
    answer = service.client.post("/duplicates/decisions", json=body)
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def test_what_can_be_undone_is_listed_act_by_act_the_latest_first(
    service: Running, copies: list[str]
) -> None:
    one, two, three, other = copies

    def acts(**wanted: int) -> list[tuple[Any, ...]]:
        found = service.client.get("/duplicates/acts", params=wanted).json()["acts"]
        told = ("action", "count", "names", "decided_by", "reason")
        return [tuple(act[name] for name in told) for act in found]

    assert acts() == []
    # The first file has two shapes, and the pair of both of them is one pair of files.
    decide(service, [one, three, other], "different", decided_by="Ann", reason="looked at")
    decide(service, [one, two], "same")
    body = {"shapes": [two, three], "keep": three}
    merged = service.client.post("/duplicates/merge", json=body).json()
    names = ["one.off", "two.off"]
    merge = ("merge", 1, ["three.off", "two.off"], None, "")
    same = ("same", 1, ["one.off"], None, "")
    assert acts(limit=2) == [merge, same]
    (_, _, different) = acts()
    assert (different[:2], *different[3:]) == (("different", 3), "Ann", "looked at")
    assert len(different[2]) == 2
    # Each is undone by its id.
    (latest, *_) = service.client.get("/duplicates/acts").json()["acts"]
    assert latest["id"] == merged["id"]
    assert service.client.post(f"/duplicates/merges/{latest['id']}/undo").json()["groups"] == 1
    assert acts()[0] == ("same", 1, names, None, "")
    (latest, *_) = service.client.get("/duplicates/acts").json()["acts"]
    assert service.client.delete(f"/duplicates/decisions/{latest['id']}").status_code == 204
    assert [act[:2] for act in acts()] == [("different", 3)]


def test_a_shape_stays_while_one_of_its_pairs_is_undecided() -> None:
    files = {1: "a", 2: "b", 3: "c", 4: "d", 5: "d"}
    decided: dict[Pair, Decision] = {pair_of("b", "a"): "same", pair_of("a", "c"): "ignore"}
    assert undecided([[1, 2, 3]], files, decided) == {2, 3}
    assert undecided([[1, 2]], files, decided) == set()
    # Two shapes with one file are a pair like any other.
    assert undecided([[4, 5]], files, decided) == {4, 5}
    assert undecided([[4, 5]], files, {**decided, pair_of("d", "d"): "same"}) == set()


def test_a_decided_pair_comes_back_only_with_another_file(service: Running, copies: list[str]) -> None:
    one, two, three, _ = copies
    client = service.client
    assert groups(service) == [{one, two, three}]
    first = decide(service, [one, two], "same")
    # Each of them is a pair with the third, which is not decided.
    assert groups(service) == [{one, two, three}]
    act = decide(service, copies[:3], "variant", decided_by="Ann", reason="checked")
    assert (act["pairs"], groups(service), groups(service, decided=True)) == (2, [], [{one, two, three}])
    pairs = client.get("/duplicates/decisions").json()
    assert pairs["total"] == 2
    said = {(each["decision"], each["decided_by"], each["reason"]) for each in pairs["decisions"]}
    assert said == {("variant", "Ann", "checked")}
    sides = [sorted(each[side]["shapes"]) for each in pairs["decisions"] for side in ("first", "second")]
    assert sorted(sides) == sorted([sorted([one, two])] * 3 + [[three]])
    # It has taken the place of the first decision.
    gone = assert_problem(client.delete(f"/duplicates/decisions/{first['id']}"), 404, "decision-not-found")
    assert gone["detail"] == f"there is no decision {first['id']!r}"

    # It lasts when shapes are renamed, and deleted and stored again.
    client.patch(f"/shapes/{one}", json={"name": "renamed.off"})
    client.delete(f"/shapes/{three}")
    again = service.store(small_file(0) + AGAIN, "again.off")["id"]
    assert (groups(service), groups(service, decided=True)) == ([], [{one, two, again}])
    rows = client.get("/duplicates", params={"decided": True, "format": "csv"}).text
    assert [row["decision"] for row in csv.DictReader(io.StringIO(rows))] == ["", "variant", "variant"]

    replaced = {"file": ("two.off", small_file(0) + b"# another\n")}
    assert client.put(f"/shapes/{two}/file", files=replaced).status_code == 200
    assert groups(service) == [{one, two, again}]
    decide(service, [one, two, again], "ignore")
    assert groups(service) == []


def test_a_pair_that_differs_joins_no_group(service: Running, copies: list[str]) -> None:
    one, two, three, other = copies
    act = decide(service, [one, three], "different")
    assert groups(service) == [{one, two}]
    assert service.client.delete(f"/duplicates/decisions/{act['id']}").status_code == 204
    assert groups(service) == [{one, two, three}]
    for wrong in ([one], [one, one], [one] * 101):
        body = {"shapes": wrong, "decision": "same"}
        assert_problem(service.client.post("/duplicates/decisions", json=body), 422, "bad-request-fields")
    body = {"shapes": [other, "no such id"], "decision": "same"}
    assert_problem(service.client.post("/duplicates/decisions", json=body), 404, "shape-not-found")


def test_a_merge_joins_what_was_written_and_can_be_undone(service: Running) -> None:
    client = service.client
    fields: dict[str, tuple[str, dict[str, Any]]] = {
        "b.off": ("red", {"x": 1, "y": "b"}),
        "a.off": ("blue,red", {"y": "a", "z": [2]}),
        "c.off": ("green", {}),
    }
    ids = [
        service.store(small_file(0) + b"# " + name.encode(), name, tags=tags, metadata=json.dumps(metadata))[
            "id"
        ]
        for name, (tags, metadata) in fields.items()
    ]

    def stored() -> list[Any]:
        records = [client.get(f"/shapes/{each}").json() for each in ids]
        for record in records:
            del record["updated_at"]
        return [records, [client.get(f"/shapes/{each}/file").content for each in ids]]

    before = stored()
    merged = client.post("/duplicates/merge", json={"shapes": ids[::-1], "keep": ids[1]}).json()
    assert merged["shape"]["tags"] == ["blue", "red", "green"]
    assert merged["shape"]["metadata"] == {"y": "a", "z": [2], "x": 1}
    (listed,) = client.get("/duplicates/merges").json()["merges"]
    assert (listed["id"], listed["shape"]) == (merged["id"], ids[1])
    assert listed["deleted"] == [ids[0], ids[2]]
    assert [shape["id"] for shape in client.get("/shapes").json()["shapes"]] == [ids[1]]
    address = f"/duplicates/merges/{merged['id']}/undo"
    # Nothing is restored where the rest cannot be undone, and the merge is kept.
    assert client.delete(f"/shapes/{ids[1]}").status_code == 204
    (left,) = client.post(address).json()["left"]
    assert (set(left["shapes"]), ids[1] in left["reason"]) == (set(ids), True)
    assert client.get("/shapes").json()["total"] == 0
    # A call that was cut off has restored some shapes, and is repeated.
    for each in (ids[1], ids[0]):
        assert client.post(f"/shapes/{each}/restore").status_code == 200
    assert client.post(address).json() == {"groups": 1, "left": []}
    assert stored() == before
    assert_problem(client.post(address), 404, "merge-not-found")
    wrong = client.post("/duplicates/merge", json={"shapes": ids, "keep": "none of them"})
    assert_problem(wrong, 422, "bad-request-fields")


def test_a_rule_is_tried_before_it_is_applied(service: Running, copies: list[str]) -> None:
    one, two, three, other = copies
    with Client(str(service.client.base_url)) as client:

        def stored() -> dict[str, Any]:
            return {shape.id: (shape.name, shape.tags, shape.metadata) for shape in client.shapes()}

        before = stored()
        for rule in (
            Rule(action="ignore", dry_run=False),
            Rule(action="merge", keep="newest", dry_run=False),
        ):
            tried = client.apply_rule(rule.model_copy(update={"dry_run": True}))
            assert (tried.groups, tried.pairs, tried.id) == (1, 3, None)
            assert client.apply_rule(rule.model_copy(update={"likeness": ["mirrored"]})).groups == 0
            assert groups(service) == [{one, two, three}]
            done = client.apply_rule(rule)
            assert done.groups == 1
            assert groups(service) == []
            if rule.action != "merge":
                assert done.id is not None
                assert len(list(client.decisions())) == done.pairs == 2
                client.delete_decision(done.id)
        left = {shape.id: shape for shape in client.shapes()}
        assert done.id is not None
        assert [each.id for each in client.merges()] == [done.id]
        assert client.undo_merge(done.id).groups == 1
        assert stored() == before
    assert set(left) == {three, other}
    assert left[three].tags == ["all", "thr", "one", "two"]
    assert left[three].metadata == {"from": "three.off", "three.off": 1, "one.off": 1, "two.off": 1}


def test_a_group_that_cannot_be_merged_by_a_rule_is_named_and_the_others_are_merged(
    service: Running, copies: list[str]
) -> None:
    full = [
        service.store(
            small_file(3) + AGAIN * number,
            f"full {number}.off",
            tags=",".join(f"{number} {i}" for i in range(20)),
        )["id"]
        for number in (1, 2)
    ]
    rule = {"action": "merge", "dry_run": False}
    answer = service.client.post("/duplicates/rule", json=rule).raise_for_status().json()
    assert (answer["groups"], answer["pairs"]) == (1, 3)
    (merged,) = service.client.get("/duplicates/merges").json()["merges"]
    assert {merged["shape"], *merged["deleted"]} == set(copies[:3])
    (left,) = answer["left"]
    assert set(left["shapes"]) == {copies[3], *full}
    assert "tags" in left["reason"]
    assert groups(service) == [{copies[3], *full}]


def test_a_rule_merges_no_group_of_which_two_shapes_are_decided_to_differ(service: Running) -> None:
    """Each was judged with the third shape, which holds the group together."""
    shapes = [service.store(small_file(5) + AGAIN * number, f"{number}.off")["id"] for number in range(3)]
    assert groups(service) == [set(shapes)]
    for pair in combinations(shapes, 2):
        decision = decide(service, [*pair], "different")
        if groups(service) == [set(shapes)]:
            break
        service.client.delete(f"/duplicates/decisions/{decision['id']}").raise_for_status()
    else:
        pytest.fail("no two shapes were judged with the third")
    rule = {"action": "merge", "dry_run": False}
    answer = service.client.post("/duplicates/rule", json=rule).raise_for_status().json()
    assert (answer["groups"], answer["id"]) == (0, None)
    (left,) = answer["left"]
    assert (set(left["shapes"]), left["reason"]) == (set(shapes), "two of its shapes are decided to differ")


def test_one_call_undoes_the_merge_of_all_groups_by_a_rule(
    service: Running, copies: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of groups that several transactions merge, but for one whose shape is gone for good."""
    monkeypatch.setattr(merges, "AT_ONCE", 1)
    more = [service.store(small_file(5) + AGAIN * number, f"{number}.off")["id"] for number in range(2)]
    lost = [service.store(small_file(6) + AGAIN * number, f"{number}.off")["id"] for number in range(2)]
    found = groups(service)
    with Client(str(service.client.base_url)) as client:
        before = {shape.id: (shape.name, shape.tags, shape.metadata) for shape in client.shapes()}
        done = client.apply_rule(Rule(action="merge", dry_run=False))
        assert (done.groups, done.pairs, done.left) == (3, 5, [])
        assert done.id is not None
        client.purge(lost[1])
        undone = client.undo_merge(done.id)
        assert (undone.groups, [left.shapes for left in undone.left]) == (2, [lost])
        assert lost[1] in undone.left[0].reason
        before.pop(lost[1])
        assert {shape.id: (shape.name, shape.tags, shape.metadata) for shape in client.shapes()} == before
    assert groups(service) == [group for group in found if group != set(lost)]
    assert {*copies[:3]} in found
    assert {*more} in found
    assert service.client.get("/duplicates/merges").json()["total"] == 1
    # It is kept as long as deleted shapes are.
    purge_old(service.container.database, timedelta(0))
    assert service.client.get("/duplicates/merges").json()["total"] == 0


def test_merges_of_one_shape_are_undone_from_the_last_one(service: Running, copies: list[str]) -> None:
    first, *others = copies[:3]
    with Client(str(service.client.base_url)) as client:
        before = list(client.shapes())
        one, two = (client.merge([first, other], keep=first).id for other in others)
        assert one is not None
        assert two is not None
        early = client.undo_merge(one)
        assert (early.groups, [left.shapes for left in early.left]) == (0, [[first, others[0]]])
        assert [client.undo_merge(each).groups for each in (two, one)] == [1, 1]
        former = {shape.id: (shape.tags, shape.metadata) for shape in before}
        assert {shape.id: (shape.tags, shape.metadata) for shape in client.shapes()} == former


def test_a_merge_for_good_has_no_undo(service: Running, copies: list[str]) -> None:
    with service.container.database.write() as session:
        merged = merges.merge(session, DEFAULT_COLLECTION.number, copies[:2], "oldest", timedelta(0))
    assert merged.id is None
    assert service.client.get("/duplicates/merges").json()["total"] == 0
