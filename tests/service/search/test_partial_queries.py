"""Queries with a part, over HTTP."""

import pytest

from core.evaluation.perturbation import cut_part
from core.io import write_mesh
from service.client import Client
from tests.gallery import make_shape
from tests.service.support import Running, query

CLASSES = ("bird", "cup", "octopus", "plane")


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Running:
    shared.clear()
    for label in CLASSES:
        shared.store(write_mesh(make_shape(label, 0), "off"), f"{label}.off", tags=label)
    return shared


def part_of(label: str, seed: int = 1) -> bytes:
    return write_mesh(cut_part(make_shape(label, 0), 0.5, seed), "off")


@pytest.mark.parametrize("label", CLASSES)
def test_the_original_of_a_part_comes_first(stocked: Running, label: str) -> None:
    answer = query(stocked.client, part_of(label), partial="true").json()
    found = answer["results"]
    assert found[0]["shape"]["name"] == f"{label}.off"
    distances = [result["part_distance"] for result in found]
    assert distances == sorted(distances)
    assert 0.0 <= distances[0] < 0.8 * distances[1]
    assert (len(found), answer["compared"], answer["stored"]) == (3, len(CLASSES), len(CLASSES))
    assert "partial=true" in answer["warnings"][0]
    plain = query(stocked.client, part_of(label)).json()["results"]
    assert all(result["part_distance"] is None for result in plain)
    scores = {result["shape"]["id"]: result["cc"] for result in plain}
    assert all(scores.get(one["shape"]["id"], one["cc"]) == one["cc"] for one in found)


def test_with_a_stored_part_and_with_filters(stocked: Running) -> None:
    part = stocked.store(part_of("octopus"), "arm.off", tags="part")
    with Client(str(stocked.client.base_url)) as client:
        answer = client.query_shape(part["id"], partial=True, top_k=1)
        assert [result.shape.name for result in answer.results] == ["octopus.off"]
        others = client.query_shape(part["id"], partial=True, tag=["plane"])
        assert [result.shape.name for result in others.results] == ["plane.off"]
        client.delete(part["id"])
        again = client.query_file(("arm.off", part_of("octopus")), partial=True, correspondences=True)
    assert again.results[0].shape.name == "octopus.off"
    assert again.results[0].correspondence
    assert again.compared == len(CLASSES)


def test_by_combined_a_part_is_found_without_asking(stocked: Running) -> None:
    for label in CLASSES:
        answer = query(stocked.client, part_of(label, seed=4), rank_by="combined").json()
        first, *others = answer["results"]
        assert first["shape"]["name"] == f"{label}.off"
        assert first["combined"] > 3.0 * max(other["combined"] for other in others)
        assert first["part_distance"] is None
        asked = query(stocked.client, part_of(label, seed=4), partial="true").json()["results"][0]
        assert asked["combined"] == first["combined"]
