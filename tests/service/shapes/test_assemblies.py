"""STEP assemblies that are split: a shape for the whole, and one for each distinct part."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from core.errors import DegenerateMeshError
from core.io import read_mesh, read_parts
from core.pipeline import Pipeline
from service.compute.tasks import Embedded
from service.shapes import service as shapes_service
from service.shapes.fields import METADATA_BYTES, METADATA_KEYS, NAME_CHARACTERS
from tests.core.io.files import off
from tests.core.io.step_files import step_box, step_circle, step_doubled, step_machine
from tests.core.io.threemf_files import components, model, package, thing
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    query,
    serving,
    settings_in,
    small_file,
    upload,
)

MACHINE = step_machine()
PARTS = ["machine.step/ring", "machine.step/pin", "machine.step/plate", "machine.step/plate"]
MOVED, DOUBLED = "1 0 0 0 1 0 0 0 1 9 9 9", "2 0 0 0 2 0 0 0 2 0 0 0"
KEY = "Idempotency-Key"


running = module_service(undo_days=1.0)


@pytest.fixture
def service(running: Running) -> Iterator[Running]:
    yield running
    running.clear()


def split(
    running: Running, data: bytes = MACHINE, filename: str = "machine.step", **fields: Any
) -> httpx.Response:
    return upload(running.client, data, filename, split="parts", **fields)


def total(running: Running, **wanted: Any) -> int:
    return int(running.client.get("/shapes", params=wanted).json()["total"])


def test_the_whole_and_each_part_are_shapes(service: Running) -> None:
    answer = split(service, tags=["2026"], metadata='{"project": "mill"}')
    assert answer.status_code == 201
    whole = answer.json()
    parts = whole["parts"]
    assert answer.headers["location"] == f"/shapes/{whole['id']}"
    assert (whole["name"], whole["format"], whole["created"]) == ("machine.step", "step", True)
    assert [part["name"] for part in parts] == PARTS
    assert [(part["format"], part["created"], part["embedded"]) for part in parts] == [
        ("3mf", True, True)
    ] * 4
    assert [part["metadata"] for part in parts] == [
        {"project": "mill", "assembly": "machine.step", "assembly_path": path, "instances": instances}
        for path, instances in [
            ("machine/use 3/use 0", 2),
            ("machine/use 3/use 1", 5),
            ("machine/use 6", 1),
            ("machine/use 7", 1),
        ]
    ]
    assert all(part["tags"] == ["2026"] for part in parts)
    for shape in (whole, *parts):
        stored = service.client.get(f"/shapes/{shape['id']}").json()
        assert stored == {key: shape[key] for key in stored}
    assert total(service) == 5
    assert total(service, metadata="assembly=machine.step") == 4
    assert total(service, metadata="instances=5") == 1


def test_the_whole_is_the_shape_that_it_is_without_split(service: Running) -> None:
    plain = service.store(MACHINE, "machine.step")
    assert "parts" not in plain
    whole = split(service).json()
    assert {key: whole[key] for key in plain} == plain
    assert not whole["created"]
    assert all(part["created"] for part in whole["parts"])


def test_a_part_is_sent_back_in_millimetres_and_found(service: Running) -> None:
    pin = split(service).json()["parts"][1]
    data = service.client.get(f"/shapes/{pin['id']}/file").content
    expected = read_mesh(step_box((1, 2, 3)), "step")
    assert np.array_equal(read_mesh(data, "3mf").vertices, expected.vertices)
    assert pin["facts"]["volume"] == pytest.approx(6)
    found = query(service.client, step_box((1, 2, 3)), "pin.step", top_k=1).json()["results"]
    assert [result["shape"]["id"] for result in found] == [pin["id"]]
    assert service.client.get(f"/shapes/{pin['id']}/thumbnail.png").status_code == 200


def test_the_objects_of_a_3mf_are_parts(service: Running) -> None:
    objects = thing(1, name="cap") + thing(2, components((1, None), (1, MOVED)), name="pen")
    answer = split(service, package(model(objects, [(2, None), (1, DOUBLED)])), "plate.3mf")
    assert answer.status_code == 201
    assert [(part["name"], part["metadata"]) for part in answer.json()["parts"]] == [
        ("plate.3mf/cap", {"assembly": "plate.3mf", "assembly_path": "pen/cap", "instances": 2}),
        ("plate.3mf/cap", {"assembly": "plate.3mf", "assembly_path": "cap", "instances": 1}),
    ]
    assert [part["facts"]["volume"] for part in answer.json()["parts"]] == pytest.approx([1, 8])
    assert total(service) == 3


def test_again_nothing_is_stored_and_what_was_deleted_is_stored_again(service: Running) -> None:
    first = split(service).json()
    again = split(service, tags=["other"])
    assert again.status_code == 200
    assert not again.json()["created"]
    assert [(part["id"], part["created"]) for part in again.json()["parts"]] == [
        (part["id"], False) for part in first["parts"]
    ]
    pin = first["parts"][1]["id"]
    assert service.client.delete(f"/shapes/{pin}").status_code == 204
    assert total(service) == 4
    third = split(service)
    assert third.status_code == 201
    assert [part["created"] for part in third.json()["parts"]] == [False, True, False, False]
    assert total(service) == 5


def test_parts_of_two_assemblies_share_their_bytes_and_not_their_shapes(service: Running) -> None:
    first, second = (split(service, filename=name).json()["parts"] for name in ("one.step", "two.step"))
    assert [part["sha256"] for part in first] == [part["sha256"] for part in second]
    assert not {part["id"] for part in first} & {part["id"] for part in second}
    assert total(service, metadata="assembly=two.step") == 4


@pytest.mark.parametrize(
    ("data", "filename"), [(step_box(), "box.step"), (small_file(0), "ball.off"), (off(), "cube.off")]
)
def test_a_file_without_parts_is_one_shape(service: Running, data: bytes, filename: str) -> None:
    answer = split(service, data, filename)
    assert answer.status_code == 201
    assert answer.json()["parts"] == []
    assert answer.json()["metadata"] == {}
    assert total(service) == 1
    assert split(service, data, filename).status_code == 200


def test_an_idempotency_key_gives_the_first_answer_again(service: Running) -> None:
    def send(**fields: str) -> httpx.Response:
        files = {"file": ("machine.step", MACHINE)}
        return service.client.post("/shapes", files=files, data=fields, headers={KEY: '"one"'})

    first = send(split="parts")
    again = send(split="parts")
    assert again.headers["idempotency-replayed"] == "true"
    assert (again.status_code, again.content) == (201, first.content)
    assert again.headers["location"] == first.headers["location"]
    assert_problem(send(), 422, "idempotency-key-reused")
    assert total(service) == 5


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (step_circle(), "malformed-mesh"),
        (step_doubled(20), "mesh-too-complex"),
        (MACHINE[: len(MACHINE) // 2], "malformed-mesh"),
        (b"", "empty-file"),
    ],
    ids=["contains itself", "a million instances", "cut", "empty"],
)
def test_a_faulty_assembly_is_refused_and_nothing_is_stored(service: Running, data: bytes, kind: str) -> None:
    assert_problem(split(service, data), 422, kind)
    assert total(service) == 0


def test_a_part_that_cannot_be_embedded_is_named_and_nothing_is_stored(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    embed = service.container.queue.embed

    async def refuse(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        if format == "3mf" and len(read_mesh(data, format).faces) > 100:
            raise DegenerateMeshError("its surface is too thin")
        return await embed(data, format, pipeline)

    monkeypatch.setattr(service.container.queue, "embed", refuse)
    problem = assert_problem(split(service), 422, "degenerate-mesh")
    assert problem["detail"] == "machine.step/ring: its surface is too thin"
    assert total(service) == 0


def test_a_fault_while_storing_leaves_nothing(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    put_shape = shapes_service.put_shape
    names = []

    def fail_late(session: Any, put: Any, new: Any) -> Any:
        names.append(new.name)
        if len(names) == 4:
            raise shapes_service.EmbeddingMissingError
        return put_shape(session, put, new)

    monkeypatch.setattr(shapes_service, "put_shape", fail_late)
    answer = split(service)
    # The first attempt is rolled back with its three shapes; the second one stores all.
    assert names == [*["machine.step", *PARTS][:4], "machine.step", *PARTS]
    assert answer.status_code == 201
    assert all(shape["created"] for shape in (answer.json(), *answer.json()["parts"]))
    assert total(service) == 5


@pytest.mark.parametrize(
    "metadata",
    [
        '{"assembly": "x"}',
        '{"instances": 1}',
        "{" + ", ".join(f'"{n}": 1' for n in range(METADATA_KEYS)) + "}",
        '{"text": "' + "x" * (METADATA_BYTES - 40) + '"}',
    ],
    ids=["a key of parts", "another", "no key left", "no room left"],
)
def test_metadata_without_room_for_that_of_the_parts_are_refused(service: Running, metadata: str) -> None:
    problem = assert_problem(split(service, metadata=metadata), 422, "bad-request-fields")
    assert [error["field"] for error in problem["errors"]] == ["metadata"]
    assert total(service) == 0
    assert upload(service.client, MACHINE, "machine.step", metadata=metadata).status_code == 201


def test_a_long_name_is_cut_before_that_of_the_part(service: Running) -> None:
    parts = split(service, name="n" * NAME_CHARACTERS).json()["parts"]
    assert [len(part["name"]) for part in parts] == [NAME_CHARACTERS] * 4
    assert parts[0]["name"].endswith("nn/ring")
    assert parts[0]["metadata"]["assembly"] == "n" * NAME_CHARACTERS


def test_different_parts_are_limited(tmp_path: Path) -> None:
    assert len(read_parts(MACHINE, "step")) == 4
    with serving(settings_in(tmp_path, max_distinct_parts=3)) as running:
        problem = assert_problem(split(running), 422, "mesh-too-complex")
        assert problem["detail"] == "the file has 4 different parts; the limit is 3"
        assert total(running) == 0
        assert upload(running.client, MACHINE, "machine.step").status_code == 201
