"""The answers of queries."""

from typing import Any

import numpy as np
import pytest
from sqlalchemy import select

from core.descriptors.registry import descriptors_of
from core.embedding import Scores
from core.ranking.local_density import densities_in, density_sample
from core.serialization import embedding_from_bytes
from service.search.repository import embedding_records
from service.storage.tables import ShapeRow
from tests.service.support import Running, pipeline_in_use, query, small_file

RESULT = {
    "difference",
    "size_ratio",
    "rank",
    "cc",
    "ssd",
    "sim",
    "combined",
    "likeness",
    "scale",
    "transform",
    "part_distance",
    "instances",
    "shape",
    "correspondence",
}


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Running:
    """The service with eight shapes, two a tag; nothing here changes them."""
    shared.clear()
    for number, label in enumerate(["bird", "bird", "chair", "chair", "snake", "snake", "pliers", "pliers"]):
        order = "second" if number % 2 else "first"
        shared.store(small_file(number), f"{label}-{order}.off", tags=[label, order])
    return shared


def test_an_answer_has_the_names_that_scripts_rely_on(stocked: Running) -> None:
    answer = query(stocked.client, small_file(20))
    assert answer.status_code == 200, answer.text
    body = answer.json()
    names = {"results", "matched", "ranked_by", "compared", "stored", "pipeline", "milliseconds", "query"}
    assert set(body) == {*names, "parts", "warnings", "embedding"}
    assert body["embedding"] is None
    assert (body["compared"], body["stored"]) == (8, 8)
    assert body["pipeline"] == stocked.client.get("/version").json()["fingerprint"]
    assert [result["rank"] for result in body["results"]] == [1, 2, 3]
    for result in body["results"]:
        assert set(result) == RESULT
        assert {"id", "name", "tags", "metadata"} <= set(result["shape"])
        assert -1 <= result["cc"] <= 1
        assert result["ssd"] >= 0
        assert 0 <= result["sim"] <= 1
        assert result["correspondence"] is None
        assert stocked.client.get(f"/shapes/{result['shape']['id']}").json() == result["shape"]
    stages = body["milliseconds"]
    assert set(stages) == {
        "read",
        "embed",
        "shortlist",
        "compare",
        "results",
        "likeness",
        "instances",
        "total",
    }
    assert all(value >= 0 for value in stages.values())
    assert sum(stages.values()) - stages["total"] <= stages["total"] + 0.01


@pytest.mark.parametrize(("rank_by", "sign"), [("cc", -1), ("ssd", 1), ("sim", -1), ("combined", -1)])
def test_results_are_sorted_as_asked_and_a_longer_answer_only_adds(
    stocked: Running, rank_by: str, sign: int
) -> None:
    fields = {"rank_by": rank_by}
    whole = query(stocked.client, small_file(20), top_k=100, **fields).json()["results"]
    assert len(whole) == 8
    values = [sign * result[rank_by] for result in whole]
    assert values == sorted(values)
    short = query(stocked.client, small_file(20), top_k=3, **fields).json()["results"]
    assert short == whole[:3]


def test_a_query_by_id_is_the_query_by_its_file(stocked: Running) -> None:
    shape = stocked.client.get("/shapes", params={"name": "snake-first"}).json()["shapes"][0]
    body = {"shape_id": shape["id"], "top_k": 8, "exclude_self": False}
    by_id = stocked.client.post("/query", json=body).json()
    by_file = query(stocked.client, small_file(4), top_k=8).json()
    assert by_id["results"] == by_file["results"]
    assert by_id["results"][0]["shape"] == shape
    stages = {"read", "shortlist", "compare", "results", "likeness", "instances", "total"}
    assert set(by_id["milliseconds"]) == stages


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"top_k": 8, "exclude_self": False, "rank_by": "combined"},
        {"tag": ["first", "snake"], "exclude_self": False},
        {"partial": True, "top_k": 2, "correspondences": True, "embedding": True},
        {"min_cc": 0.5, "scale": "respect", "exhaustive": True, "name": "first"},
    ],
)
def test_similar_shapes_are_the_query_by_id(stocked: Running, options: dict[str, Any]) -> None:
    shape = stocked.client.get("/shapes", params={"name": "snake-first"}).json()["shapes"][0]
    by_body = stocked.client.post("/query", json={"shape_id": shape["id"], **options}).json()
    by_address = stocked.client.get(f"/shapes/{shape['id']}/similar", params=options).json()
    times = by_body.pop("milliseconds"), by_address.pop("milliseconds")
    assert set(times[0]) == set(times[1])
    assert by_address == by_body


def test_options_may_stand_in_the_address_the_form_or_the_object(stocked: Running) -> None:
    data = {"file": ("bird.off", small_file(20))}
    in_form = stocked.client.post("/query", files=data, data={"top_k": 2, "tag": ["first"]}).json()
    in_address = stocked.client.post("/query?top_k=2&tag=first", files=data).json()
    both = stocked.client.post("/query?top_k=5&tag=first", files=data, data={"top_k": 2}).json()
    assert len(in_form["results"]) == 2
    assert in_form["results"] == in_address["results"] == both["results"]
    shape_id = in_form["results"][0]["shape"]["id"]
    as_object = stocked.client.post("/query", json={"shape_id": shape_id, "top_k": 1, "tag": ["first"]})
    as_text = stocked.client.post("/query?top_k=1", json={"shape_id": shape_id, "tag": "first"})
    assert as_object.json()["results"] == as_text.json()["results"]


def test_matched_says_whether_a_result_is_alike(stocked: Running) -> None:
    for rank_by in ("cc", "ssd", "combined"):
        itself = query(stocked.client, small_file(0), top_k=1, rank_by=rank_by).json()
        assert itself["matched"] is True
    others = query(stocked.client, small_file(0), tag="pliers", top_k=100).json()
    assert others["matched"] is any(result["likeness"] != "weak" for result in others["results"])
    none = query(stocked.client, small_file(0), tag="nothing").json()
    assert none["matched"] is False


def test_combined_is_the_pipelines_and_the_same_in_every_answer(stocked: Running) -> None:
    pipeline = pipeline_in_use(stocked)
    shapes = stocked.client.get("/shapes").json()["shapes"]
    stored = {s["name"]: s["id"] for s in shapes}
    with stocked.container.database.read() as session:
        entries = stocked.container.pipelines.current(session).index.current(session)
        records = embedding_records(session, entries.embeddings.tolist())
        ids = dict(session.execute(select(ShapeRow.number, ShapeRow.id)).all())
    # The index is in no order that a client sees.
    embeddings = {
        ids[shape]: embedding_from_bytes(records[embedding])
        for shape, embedding in zip(entries.shapes.tolist(), entries.embeddings.tolist(), strict=True)
    }
    assert set(embeddings) == set(stored.values())
    bird = stored["bird-first.off"]
    body = {"shape_id": bird, "top_k": 100, "exclude_self": False, "rank_by": "combined"}
    results = stocked.client.post("/query", json=body).json()["results"]
    assert results[0]["shape"]["id"] == bird
    described = {shape_id: descriptors_of(embedding) for shape_id, embedding in embeddings.items()}
    sample = density_sample(list(described.values()))
    own = densities_in(sample, [described[bird]])
    for result in results:
        scores = Scores(*(np.array([result[name]]) for name in ("cc", "ssd", "sim")))
        other = result["shape"]["id"]
        densities = densities_in(sample, [described[other]])
        (expected,) = pipeline.combined(embeddings[bird], [embeddings[other]], scores, own, densities)
        pair = {"first": other, "second": bird}
        compared = stocked.client.post("/compare", json=pair).json()
        assert compared["combined"] == pytest.approx(expected, abs=1e-9)
        assert 0.0 <= result["combined"] <= 1.0
        assert result["combined"] == pytest.approx(expected, abs=1e-9)
    alone = query(stocked.client, small_file(20), tag="bird,first").json()["results"]
    together = query(stocked.client, small_file(20), top_k=100).json()["results"]
    (same,) = [result for result in together if result["shape"]["id"] == alone[0]["shape"]["id"]]
    assert alone[0]["combined"] == pytest.approx(same["combined"], abs=1e-9)


def test_correspondences_are_those_of_the_comparison(stocked: Running) -> None:
    shapes = {s["name"]: s for s in stocked.client.get("/shapes").json()["shapes"]}
    bird = shapes["bird-first.off"]["id"]
    body = {"shape_id": bird, "top_k": 2, "correspondences": True}
    results = stocked.client.post("/query", json=body).json()["results"]
    assert len(results) == 2
    for result in results:
        compared = stocked.client.post(
            "/compare", json={"first": bird, "second": result["shape"]["id"]}
        ).json()
        assert compared["correspondence"] == result["correspondence"]
        for measure in ("cc", "ssd", "sim", "combined"):
            assert compared[measure] == pytest.approx(result[measure], abs=1e-9)


def test_a_comparison_gives_both_ends_of_each_pair(stocked: Running) -> None:
    shapes = {s["name"]: s for s in stocked.client.get("/shapes").json()["shapes"]}
    first, second = shapes["bird-first.off"]["id"], shapes["bird-second.off"]["id"]
    answer = stocked.client.post("/compare", json={"first": first, "second": second}).json()
    dense = {"vertices", "confidence", "length_ratio", "simplified", "first_difference", "second_difference"}
    dense |= {"maps", "ambiguous", "mirrored", "transferred", "instances"}
    sparse = {
        "cc",
        "ssd",
        "sim",
        "combined",
        "correspondence",
        "pipeline",
        "milliseconds",
        "likeness",
        "scale",
        "transform",
        "difference",
    }
    assert set(answer) == sparse | dense
    assert {answer[name] for name in dense} == {None}
    assert answer["correspondence"]
    for end, shape_id in (("first", first), ("second", second)):
        embedding = stocked.client.get(f"/shapes/{shape_id}/embedding").json()
        for pair in answer["correspondence"]:
            sample = pair[end]["sample"]
            assert pair[end]["position"] == embedding["positions"][sample]
            assert pair[end]["vertex"] == embedding["vertices"][sample]
    assert all(pair["distance"] >= 0 for pair in answer["correspondence"])
    back = stocked.client.post("/compare", json={"first": second, "second": first}).json()
    assert back["cc"] == pytest.approx(answer["cc"], abs=1e-9)
    itself = stocked.client.post("/compare", json={"first": first, "second": first}).json()
    assert (itself["cc"], itself["ssd"], itself["sim"]) == pytest.approx((1, 0, 1), abs=1e-6)
