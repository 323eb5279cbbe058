"""The graph of neighbours: complete, whatever comes and goes, and an order of results."""

from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import expit
from sqlalchemy import delete, select

from core.io import write_mesh
from core.ranking.diffusion import NEIGHBOURS, NOBODY, NeighbourRows
from service.collections.endpoints import HEADER
from service.index import neighbour_repository
from service.index.neighbour_repository import Compared
from service.search import neighbours
from service.search.answer import NO_CONTEXT
from service.storage.checking import check
from service.storage.copying import copy_archive
from service.storage.database import Database
from service.storage.tables import NeighboursRow, ShapeRow
from tests.gallery import make_shape
from tests.service.engines import on_both, url_in
from tests.service.support import (
    Running,
    assert_problem,
    query,
    relate,
    serving,
    settings_in,
    small_file,
    wait_until,
)

LABELS, POSES = ("fish", "glasses", "hand"), 3


def made(label: str, pose: int) -> bytes:
    return write_mesh(make_shape(label, pose), "ply")


def graph(running: Running) -> NeighbourRows:
    with running.container.database.read() as session:
        fingerprint = running.container.pipelines.current(session).fingerprint
        return neighbour_repository.neighbour_rows(session, fingerprint)


def named(running: Running) -> dict[int, str]:
    """The names of the shapes, by number."""
    with running.container.database.read() as session:
        return dict(session.execute(select(ShapeRow.number, ShapeRow.name)).all())


def names(answer: dict[str, Any]) -> list[str]:
    return [result["shape"]["name"] for result in answer["results"]]


@pytest.fixture(scope="module")
def stocked(shared: Running) -> tuple[Running, dict[str, str]]:
    """A service with some classes in poses, their rows made as they came, and the ids by name."""
    shared.clear()
    ids = {}
    for pose in range(POSES):
        for label in LABELS:
            name = f"{label}{pose}"
            ids[name] = shared.store(made(label, pose), f"{name}.ply", name=name, tags=label)["id"]
        relate(shared)
    return shared, ids


@on_both
def test_rows_have_all_others_by_their_log_odds(stocked: tuple[Running, dict[str, str]]) -> None:
    running, ids = stocked
    rows, name_of = graph(running), named(running)
    assert [name_of[number] for number in rows.shapes.tolist()] == list(ids)
    for number, near, log_odds in zip(rows.shapes.tolist(), rows.neighbours, rows.log_odds, strict=True):
        known = near != NOBODY
        assert sorted(near[known].tolist()) == [each for each in rows.shapes.tolist() if each != number]
        assert (np.diff(log_odds[known]) <= 0.0).all()
        if not name_of[number].endswith("1"):
            continue
        body = {"shape_id": ids[name_of[number]], "rank_by": "combined", "top_k": 100}
        asked = running.client.post("/query", json=body).json()["results"]
        told = {result["shape"]["name"]: result["combined"] for result in asked}
        for other, odds in zip(near[known].tolist(), log_odds[known], strict=True):
            # The densities of the collection were others when the pair was compared.
            assert float(expit(odds)) == pytest.approx(told[name_of[other]], abs=0.25)


@on_both
def test_a_stored_query_has_the_context_of_its_file(stocked: tuple[Running, dict[str, str]]) -> None:
    running, ids = stocked
    options = {"rank_by": "contextual", "top_k": 100, "exclude_self": True}
    for name in ("fish0", "hand2"):
        by_id = running.client.post("/query", json={"shape_id": ids[name], **options}).json()
        by_file = query(running.client, made(name[:-1], int(name[-1])), "q.ply", **options).json()
        assert by_id["ranked_by"] == by_file["ranked_by"] == "contextual"
        assert not by_id["warnings"]
        assert names(by_id) == names(by_file)
        assert len(by_id["results"]) == len(ids) - 1
        assert {each[:-1] for each in names(by_id)[: POSES - 1]} == {name[:-1]}
        assert "context" in by_id["milliseconds"]
        similar = running.client.get(f"/shapes/{ids[name]}/similar", params=options).json()
        assert names(similar) == names(by_id)
    # The filter chooses results, and the graph around them stays.
    body = {"shape_id": ids["fish0"], "tag": ["hand"], "rank_by": "contextual", "top_k": 9}
    answer = running.client.post("/query", json=body).json()
    assert {each[:-1] for each in names(answer)} == {"hand"}
    assert answer["ranked_by"] == "contextual"


@on_both
def test_neighbours_are_near_each_other_on_the_map(stocked: tuple[Running, dict[str, str]]) -> None:
    running, ids = stocked
    found = running.client.get("/map").json()
    assert found == running.client.get("/map").json()
    assert {shape["name"] for shape in found["shapes"]} == set(ids)
    points = np.array([(shape["x"], shape["y"]) for shape in found["shapes"]])
    labels = np.array([shape["name"][:-1] for shape in found["shapes"]])
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    same = labels[:, None] == labels
    assert distances[same].max() < distances[~same].min()


@on_both
def test_families_are_the_classes(
    stocked: tuple[Running, dict[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """However few rows are read at once."""
    running, _ = stocked
    monkeypatch.setattr(neighbour_repository, "AT_ONCE", 4)
    found = running.client.get("/families").json()
    families = [{shape["name"] for shape in family["shapes"]} for family in found["families"]]
    assert families == [{f"{label}{pose}" for pose in range(POSES)} for label in LABELS]
    assert (found["single"], found["unknown"]) == (0, 0)
    # A filter shows less of a family, and joins or parts none.
    one = running.client.get("/families", params={"name": "1"}).json()
    assert (one["families"], one["single"]) == ([], len(LABELS))
    fish = running.client.get("/families", params={"tag": "fish"}).json()["families"]
    assert [[shape["name"] for shape in family["shapes"]] for family in fish] == [["fish0", "fish1", "fish2"]]
    assert_problem(
        running.client.get("/families", params={"least_probability": 1}), 422, "bad-request-fields"
    )


@on_both
def test_neighbours_suggest_what_a_shape_lacks(stocked: tuple[Running, dict[str, str]]) -> None:
    running, ids = stocked
    client, address = running.client, f"/shapes/{ids['fish0']}"
    suggestions = f"{address}/suggestions"
    assert client.get(suggestions).json() == {"suggestions": [], "known": True}
    assert client.patch(address, json={"tags": []}).status_code == 200
    for pose, legs in ((1, 0), (2, 0)):
        client.patch(f"/shapes/{ids[f'fish{pose}']}", json={"metadata": {"legs": legs, "size": [pose]}})
    (tag, legs) = client.get(suggestions).json()["suggestions"]
    assert (tag["key"], tag["value"]) == (None, "fish")
    assert (legs["key"], legs["value"]) == ("legs", 0)
    assert {shape["name"] for shape in tag["shapes"]} == {"fish1", "fish2"}
    assert 0.5 < tag["share"] == legs["share"] <= 1.0
    # Each neighbour has one tag, and none is lacking.
    every = client.get(suggestions, params={"least_share": 1e-9}).json()["suggestions"]
    assert sum(each["share"] for each in every if each["key"] is None) == pytest.approx(1.0)
    assert client.patch(address, json={"tags": ["fish"], "metadata": {"legs": 2}}).status_code == 200
    assert client.get(suggestions).json()["suggestions"] == []
    assert_problem(client.get("/shapes/none/suggestions"), 404, "shape-not-found")
    assert_problem(client.get(suggestions, params={"least_share": 2}), 422, "bad-request-fields")


@on_both
def test_without_enough_rows_the_order_is_that_of_combined(service: Running) -> None:
    empty = query(service.client, small_file(1), rank_by="contextual").json()
    assert (empty["ranked_by"], empty["results"], empty["warnings"]) == ("contextual", [], [])
    for number in range(3):
        service.store(small_file(number), f"{number}.off")
    lacking = query(service.client, small_file(1), rank_by="contextual").json()
    assert (lacking["ranked_by"], lacking["warnings"]) == ("combined", [NO_CONTEXT])
    assert names(lacking) == names(query(service.client, small_file(1), rank_by="combined").json())
    (stored, *_) = service.client.get("/shapes").json()["shapes"]
    unknown = service.client.get(f"/shapes/{stored['id']}/suggestions").json()
    assert unknown == {"suggestions": [], "known": False}
    relate(service)
    known = query(service.client, small_file(1), rank_by="contextual").json()
    assert (known["ranked_by"], known["warnings"]) == ("contextual", [])


@on_both
def test_shapes_that_go_leave_no_row_behind(service: Running) -> None:
    ids = [service.store(small_file(number), f"{number}.off")["id"] for number in range(5)]
    relate(service)
    assert service.rows(NeighboursRow) == 5
    assert service.client.delete(f"/shapes/{ids[0]}").status_code == 204
    files = {"file": ("other.off", small_file(7))}
    assert service.client.put(f"/shapes/{ids[1]}/file", files=files).status_code == 200
    assert service.client.put("/collections/elsewhere").status_code in {200, 201}
    moved = service.client.patch(f"/shapes/{ids[2]}", json={"collection": "elsewhere"})
    assert moved.status_code == 200, moved.text
    relate(service)
    rows, name_of = graph(service), named(service)
    assert service.rows(NeighboursRow) == 4
    alone = [
        name_of[number]
        for number, near in zip(rows.shapes.tolist(), rows.neighbours, strict=True)
        if (near == NOBODY).all()
    ]
    assert alone == ["2.off"]
    others = {number for number in rows.shapes.tolist() if name_of[number] != "2.off"}
    for number, near in zip(rows.shapes.tolist(), rows.neighbours, strict=True):
        if number in others:
            assert set(near[near != NOBODY].tolist()) == others - {number}
    files = {"file": ("query.off", small_file(3))}
    fields, elsewhere = {"rank_by": "contextual"}, {HEADER: "elsewhere"}
    there = service.client.post("/query", files=files, data=fields, headers=elsewhere)
    assert names(there.json()) == ["2.off"]
    assert service.client.delete(f"/shapes/{ids[2]}", headers=elsewhere).status_code == 204
    assert service.client.delete("/collections/elsewhere").status_code == 204


def test_a_row_keeps_the_likeliest(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of more shapes than a row has room for, also after a shape that is compared with few of them."""
    monkeypatch.setattr(neighbours, "SHORTLIST_FROM", 2)
    for number in range(NEIGHBOURS + 2):
        service.store(small_file(number), f"{number}.off")
    relate(service)
    rows = graph(service)
    assert (rows.neighbours != NOBODY).all()
    for number, near in zip(rows.shapes.tolist(), rows.neighbours, strict=True):
        assert len(set(near.tolist()) - {number}) == NEIGHBOURS
    with service.container.database.write() as session:
        fingerprint = service.container.pipelines.current(session).fingerprint
        (first, second), embedding = (
            rows.shapes[:2].tolist(),
            session.scalar(
                select(neighbour_repository.EmbeddingRow.number).order_by(
                    neighbour_repository.EmbeddingRow.number
                )
            ),
        )
        compared = Compared(first, embedding, np.array([second]), np.array([99.0]))
        neighbour_repository.write(session, fingerprint, [compared])
    changed = graph(service)
    assert changed.neighbours[0].tolist() == [second] + [NOBODY] * (NEIGHBOURS - 1)
    assert (changed.neighbours[1, 0], changed.log_odds[1, 0]) == (first, 99.0)
    kept = [each for each in rows.neighbours[1].tolist() if each != first]
    assert changed.neighbours[1, 1:].tolist() == kept[: NEIGHBOURS - 1]


def test_rows_do_not_depend_on_how_many_shapes_are_compared_at_a_time(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Few candidates make the order in which rows are stored count."""
    monkeypatch.setattr(neighbours, "SHORTLIST_FROM", 2)
    monkeypatch.setattr(neighbours, "ROW_CANDIDATES", 6)
    for number in range(NEIGHBOURS):
        service.store(small_file(number), f"{number}.off")
    found = []
    for workers in (1, 5):
        with service.container.database.write() as session:
            session.execute(delete(NeighboursRow))
        relate(service, workers)
        found.append(graph(service))
    for one, other in zip(*map(astuple, found), strict=True):
        np.testing.assert_array_equal(one, other)


@on_both
def test_the_background_makes_rows_and_copies_hold_them(tmp_path: Path, engine: str) -> None:
    with serving(settings_in(tmp_path, duplicates_in_background=True)) as running:
        for number in range(3):
            running.store(small_file(number), f"{number}.off")
        wait_until(lambda: running.rows(NeighboursRow) == 3, seconds=120)
    source, path = Database(url_in(tmp_path), lock_seconds=1), tmp_path / "copy.sqlite3"
    target = Database(f"sqlite:///{path}", lock_seconds=1)
    copy_archive(source, target, lambda *_: None)
    with source.read() as one, target.read() as other:
        found = [session.execute(select(NeighboursRow.__table__)).all() for session in (one, other)]
        assert found[0] == found[1] != []
    source.close()
    target.close()
    assert check(path, lock_seconds=1).faults == []
