"""Queries with a part, over HTTP."""

from collections.abc import Iterator

import pytest

from core.gallery import make_shape
from core.io import write_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.studies.perturbation import cut_part
from service.client import Client
from service.compute.request_queue import RequestQueue
from service.errors import WorkerLostError
from tests.service.support import Running, assert_problem, query, serving, settings_in

CLASSES = ("bird", "cup", "octopus", "plane")


@pytest.fixture(scope="module")
def stocked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with serving(settings_in(tmp_path_factory.mktemp("partial"))) as running:
        for label in CLASSES:
            running.store(write_mesh(make_shape(label, 0), "off"), f"{label}.off", tags=label)
        yield running


def part_of(label: str) -> bytes:
    return write_mesh(cut_part(make_shape(label, 0), 0.5, 1), "off")


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
        # Made once: the patches of a shape that is gone are asked for no more.
        client.delete(part["id"])
        again = client.query_file(("arm.off", part_of("octopus")), partial=True, correspondences=True)
    assert again.results[0].shape.name == "octopus.off"
    assert again.results[0].correspondence
    assert again.compared == len(CLASSES)
    wrong = query(stocked.client, part_of("cup"), partial="perhaps")
    assert_problem(wrong, 422, "bad-request-fields")


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """An archive of before patches were kept: what lies about points is made of the files."""
    folder = tmp_path_factory.mktemp("before")
    (folder / "old.json").write_text(DEFAULT.with_values(name="old", patches=False).to_json())
    with serving(settings_in(folder, pipeline=str(folder / "old.json"))) as running:
        for label in CLASSES:
            running.store(write_mesh(make_shape(label, 0), "off"), f"{label}.off", tags=label)
        yield running


def test_an_archive_of_before_patches_were_kept_is_searched_too(stocked: Running, before: Running) -> None:
    for rank_by in ("cc", "combined"):
        found = query(before.client, part_of("octopus"), partial="true", rank_by=rank_by).json()["results"]
        now = query(stocked.client, part_of("octopus"), partial="true", rank_by=rank_by).json()["results"]
        names = [[result["shape"]["name"] for result in results] for results in (found, now)]
        assert names[0] == names[1]
        for one, other in zip(found, now, strict=True):
            assert one["part_distance"] == pytest.approx(other["part_distance"], rel=1e-9)
            assert one["cc"] == other["cc"]


def test_by_combined_a_part_is_found_without_asking(stocked: Running) -> None:
    for label in CLASSES:
        answer = query(stocked.client, part_of(label), rank_by="combined").json()
        first, *others = answer["results"]
        assert first["shape"]["name"] == f"{label}.off"
        assert first["combined"] > 3.0 * max(other["combined"] for other in others)
        assert first["part_distance"] is None
        asked = query(stocked.client, part_of(label), partial="true").json()["results"][0]
        assert asked["combined"] == first["combined"]


def test_a_worker_that_is_lost_meanwhile_is_said(before: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    read = RequestQueue.read
    lost = []

    async def losing(self: RequestQueue, data: bytes, format: str) -> Mesh:
        # The query's own file is read; those of stored shapes are lost.
        if len(data) != len(part_of("bird")):
            lost.append(format)
            raise WorkerLostError("a worker process was lost")
        return await read(self, data, format)

    monkeypatch.setattr(before.container.spin_images, "get", lambda numbers: {})
    monkeypatch.setattr(RequestQueue, "read", losing)
    assert_problem(query(before.client, part_of("bird"), partial="true"), 503, "worker-lost")
    assert lost
