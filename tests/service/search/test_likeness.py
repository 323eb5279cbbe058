"""The likeness of results and of compared shapes, over HTTP."""

import asyncio
from functools import cache
from typing import Any

import httpx
import numpy as np
import pytest
from starlette.concurrency import run_in_threadpool

from core.errors import CannotBeEmbeddedError
from core.io import write_mesh
from core.mesh.mesh import Mesh
from core.ranking.likeness import SIMILAR
from service.errors import WorkerLostError
from service.search import likeness
from service.search import results as search_results
from service.search.records import once
from service.search.results import AT_ONCE, CERTAIN
from tests.gallery import make_body
from tests.service.support import Running, query
from tests.studies.copies import moved, simplified
from tests.studies.machine_parts import Change, Drawing, part

TOLD = {"turned": "same", "larger": "scaled", "simplified": "same", "mirrored": "mirrored", "posed": "pose"}
RELATION = ("likeness", "scale", "transform", "difference", "instances")


@cache
def octopus() -> Mesh:
    return make_body("octopus").posed(0)


@cache
def stored() -> dict[str, Mesh]:
    return {
        "turned": moved(octopus(), 1),
        "larger": moved(octopus(), 2, scale=1.5),
        "simplified": moved(simplified(octopus()), 3),
        "mirrored": moved(octopus(), 4, mirrored=True),
        "posed": make_body("octopus", vertices=1800).posed(1),
        "cup": make_body("cup").posed(0),
        "plane": make_body("plane").posed(0),
    }


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Running:
    shared.clear()
    for name, mesh in stored().items():
        shared.store(file_of(mesh), f"{name}.off", tags=name)
    return shared


def file_of(mesh: Mesh) -> bytes:
    return write_mesh(mesh, "off")


def by_name(answer: httpx.Response) -> dict[str, dict[str, Any]]:
    return {result["shape"]["name"].removesuffix(".off"): result for result in answer.json()["results"]}


@pytest.fixture(scope="module")
def found(stocked: Running) -> dict[str, dict[str, Any]]:
    return by_name(query(stocked.client, file_of(octopus()), top_k="9"))


def test_each_result_says_by_what_it_is_alike(found: dict[str, dict[str, Any]]) -> None:
    assert found.keys() == stored().keys()
    assert {name: found[name]["likeness"] for name in TOLD} == TOLD
    for name in ("cup", "plane"):
        assert (found[name]["likeness"], found[name]["combined"] < SIMILAR) == ("weak", True)


def test_results_are_registered_some_at_a_time(
    stocked: Running, found: dict[str, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    relation_of = search_results.relation_of
    now, most = 0, 0

    async def counted(*surfaces: Any, **scores: float) -> dict[str, Any]:
        nonlocal now, most
        now += 1
        most = max(most, now)
        try:
            await asyncio.sleep(0.01)
            return await relation_of(*surfaces, **scores)
        finally:
            now -= 1

    monkeypatch.setattr(search_results, "relation_of", counted)
    again = by_name(query(stocked.client, file_of(octopus()), top_k="9"))
    assert most == AT_ONCE < len(stored())
    assert again == found
    assert list(again) == list(found)


def test_a_mesh_that_two_ask_for_at_a_time_is_read_once() -> None:
    reads = 0

    async def read() -> Mesh:
        nonlocal reads
        reads += 1
        await asyncio.sleep(0.01)
        return octopus()

    async def both() -> list[Mesh]:
        kept = once(read)
        return [*await asyncio.gather(kept(), kept()), await kept()]

    assert all(mesh is octopus() for mesh in asyncio.run(both()))
    assert reads == 1


def test_the_word_follows_the_number_however_dense_the_surroundings_are(stocked: Running) -> None:
    data = file_of(make_body("cup", 1, vertices=1800).posed(0))
    answers = [query(stocked.client, data, top_k=20).json()]
    cup = stored()["cup"]
    copies = [stocked.store(file_of(moved(cup, 10 + k)), f"copy-{k}.off")["id"] for k in range(7)]
    try:
        answers.append(query(stocked.client, data, top_k=20).json())
    finally:
        for copy in copies:
            stocked.client.delete(f"/shapes/{copy}")
    for answer in answers:
        told = [(result["likeness"], result["combined"] >= SIMILAR) for result in answer["results"]]
        assert set(told) == {("similar", True), ("weak", False)}
        assert answer["matched"] == any(word != "weak" for word, _ in told)


def test_copies_precede_variants_and_these_what_is_no_rigid_copy(shared: Running) -> None:
    """All of them are certainly of one class, so that their order is that of what registration finds."""
    drawn: dict[str, Change] = {"hole more": "hole", "hole larger": "larger", "longer": "longer"}
    parts = {name: part("bracket", Drawing(5, 0.1, change=change)) for name, change in drawn.items()}
    first = part("bracket", Drawing(5, 0.1))
    parts |= {"another": part("bracket", Drawing(6, 0.1)), "inches": moved(first, 2, scale=1 / 25.4)}
    parts |= {"other hand": moved(first, 4, mirrored=True)}
    parts |= {"remeshed": moved(part("bracket", Drawing(5, 0.05, 0.4)), 3)}
    for name, mesh in parts.items():
        shared.store(file_of(mesh), f"{name}.off", tags="brackets")
    answer = query(shared.client, file_of(first), tag="brackets", rank_by="combined", top_k=5)
    found = by_name(answer)
    assert all(result["combined"] > CERTAIN for result in found.values())
    assert [result["rank"] for result in answer.json()["results"]] == [1, 2, 3, 4, 5]
    assert list(found)[:3] == ["remeshed", "other hand", "inches"]
    assert set(list(found)[3:]) < {"hole more", "hole larger", "longer"}


def test_only_copies_have_a_scale(found: dict[str, dict[str, Any]]) -> None:
    assert found["turned"]["scale"] == pytest.approx(1.0, rel=1e-5)
    assert found["larger"]["scale"] == pytest.approx(1.5, rel=1e-5)
    assert found["simplified"]["scale"] == pytest.approx(1.0, rel=0.01)
    assert all(found[name]["scale"] is None for name in ("posed", "cup", "plane"))
    assert found["mirrored"]["scale"] == pytest.approx(1.0, rel=0.01)


def test_the_transform_of_a_copy_takes_it_back(found: dict[str, dict[str, Any]]) -> None:
    for name in ("turned", "larger", "mirrored"):
        vertices = stored()[name].vertices
        ends = np.column_stack([vertices, np.ones(len(vertices))])
        back = ends @ np.array(found[name]["transform"]).T
        assert np.abs(back[:, :3] - octopus().vertices).max() <= 0.002 * np.ptp(octopus().vertices)
    assert found["posed"]["transform"] is None


def test_every_way_to_ask_tells_the_same(stocked: Running, found: dict[str, dict[str, Any]]) -> None:
    own = stocked.store(file_of(octopus()), "octopus.off")["id"]
    answers = [
        stocked.client.get(f"/shapes/{own}/similar", params={"top_k": 9}),
        query(stocked.client, file_of(octopus()), top_k="9", rank_by="combined", exclude=own),
        query(stocked.client, file_of(octopus()), top_k="9", partial="true", exclude=own),
    ]
    for answer in answers:
        results = by_name(answer)
        assert {name: results[name]["likeness"] for name in TOLD} == TOLD
        assert "likeness" in answer.json()["milliseconds"]
    for result in (found[name] for name in TOLD):
        pair = {"first": own, "second": result["shape"]["id"]}
        compared = stocked.client.post("/compare", json=pair).json()
        assert compared["likeness"] == result["likeness"]
        assert compared["scale"] == (result["scale"] and pytest.approx(result["scale"], rel=1e-9))
    stocked.client.delete(f"/shapes/{own}")


def test_a_pair_is_registered_once(
    stocked: Running, found: dict[str, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[str] = []
    read = likeness.stored_mesh

    async def counted(container: Any, collection: Any, shape_id: str) -> Mesh:
        reads.append(shape_id)
        return await read(container, collection, shape_id)

    monkeypatch.setattr(likeness, "stored_mesh", counted)
    stocked.container.relations.clear()
    for known in (False, True):
        reads.clear()
        again = by_name(query(stocked.client, file_of(octopus()), top_k="9"))
        for name in found:
            assert [again[name][key] for key in RELATION] == [found[name][key] for key in RELATION]
        assert (reads == []) == known
    other = by_name(query(stocked.client, file_of(moved(stored()["simplified"], 9)), top_k="9"))
    assert reads
    assert other["simplified"]["likeness"] == "same"


def test_a_shape_that_goes_while_it_is_registered_is_no_copy(
    stocked: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = stocked.store(file_of(stored()["simplified"]), "gone.off", tags="gone")["id"]
    stocked.container.relations.clear()
    read = likeness.stored_mesh

    async def late(*given: Any) -> Mesh:
        await run_in_threadpool(stocked.client.delete, f"/shapes/{gone}")
        return await read(*given)

    monkeypatch.setattr(likeness, "stored_mesh", late)
    results = by_name(query(stocked.client, file_of(octopus()), tag="gone"))
    assert results["gone"]["likeness"] == "similar"
    assert results["gone"]["scale"] is None


@pytest.mark.parametrize("error", [WorkerLostError("a worker"), CannotBeEmbeddedError("the method fails")])
def test_a_registration_that_fails_costs_the_answer_nothing_else(
    stocked: Running, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    async def fails(*_given: Any) -> Mesh:
        raise error

    stocked.container.relations.clear()
    monkeypatch.setattr(likeness, "stored_mesh", fails)
    answer = query(stocked.client, file_of(octopus()), tag="simplified")
    assert answer.status_code == 200
    assert [result["likeness"] for result in answer.json()["results"]] == ["similar"]
