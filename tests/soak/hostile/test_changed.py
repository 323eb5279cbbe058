"""Changed files over HTTP: some of those that `python -m tests.soak.hostile.changed` sends."""

import io
from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from service.storage.sqlite import path_of
from tests.core.io.files import PLAIN
from tests.service.support import Running, serving, settings_in
from tests.service.trouble import url_of
from tests.soak.hostile.changed import faults_of_archive, upload_changed
from tests.soak.hostile.mutation import mutation, mutations, sources
from tests.soak.hostile.stored import fault_in_embedding, fault_in_mesh, other_format

COUNT = 20


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with serving(settings_in(tmp_path_factory.mktemp("changed"))) as running:
        yield running


def test_the_files_to_change_are_sound_and_of_every_format() -> None:
    assert {format for format, _ in sources()} == set(PLAIN)
    for format, data in sources():
        assert len(read_mesh(data, format).faces) > 100


def test_the_changes_are_the_same_each_time_and_change_something() -> None:
    first = list(islice(mutations(3), 50))
    assert first == list(islice(mutations(3), 50))
    assert len(set(first)) == 50
    assert not set(first) & set(islice(mutations(4), 50))
    unchanged = [mutation(3, number) in sources() for number in range(200)]
    assert sum(unchanged) < 20


def test_few_changes_are_taken_and_refused(running: Running) -> None:
    """`python -m tests.soak.hostile.changed` does the same with many."""
    tally = upload_changed(running.client, COUNT, seed=1)
    assert tally.faults == []
    assert sum(tally.answers.values()) == COUNT
    assert list(faults_of_archive(path_of(url_of(running.container.database)), tally)) == []
    assert tally.count("stored") > 0
    assert tally.count("malformed-mesh") > 0


def test_a_wrong_embedding_would_be_seen(running: Running) -> None:
    format, data = sources()[0]
    answer = running.client.post("/shapes", files={"file": (f"sound.{format}", data)})
    facts = answer.json()["facts"]
    npz = running.client.get(answer.headers["location"] + "/embedding", params={"format": "npz"}).content
    assert fault_in_embedding(facts, npz) == ""
    with np.load(io.BytesIO(npz)) as arrays:
        sound = dict(arrays)
    for name, place, value in (
        ("positions", (0, 0), np.nan),
        ("signature", (0,), np.inf),
        ("vertices", (3,), facts["vertices"]),
        ("graph_edges", (0, 0), -1),
        ("tree_edges", (0, 1), len(sound["positions"])),
        ("regions", (9,), len(sound["positions"])),
    ):
        wrong = sound[name].copy()
        wrong[place] = value
        buffer = io.BytesIO()
        np.savez(buffer, **{**sound, name: wrong})
        assert name in fault_in_embedding(facts, buffer.getvalue())
    assert "area" in fault_in_embedding({**facts, "area": 0.0}, npz)
    assert "nan" in fault_in_embedding({**facts, "volume": float("nan")}, npz)


@pytest.mark.parametrize("format", ["off", "obj"])
def test_a_wrong_mesh_would_be_seen(format: str) -> None:
    assert other_format(format) != format
    mesh = read_mesh(sources()[0][1], sources()[0][0])
    facts = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    sound = write_mesh(mesh, format)
    assert fault_in_mesh(facts, sound, format) == ""
    first = repr(float(mesh.vertices[0, 0])).encode()
    assert fault_in_mesh(facts, sound.replace(first, b"nan", 1), format) == "a coordinate is not finite"
    assert "facts" in fault_in_mesh({**facts, "faces": facts["faces"] + 1}, sound, format)
    for broken in (b"", b"v " + sound, sound[: len(sound) // 2]):
        assert fault_in_mesh(facts, broken, format) != ""
    far = np.where(mesh.faces == 0, len(mesh.vertices), mesh.faces)
    unchecked = type("Unchecked", (), {"vertices": mesh.vertices, "faces": far})
    assert "outside" in fault_in_mesh(facts, write_mesh(unchecked, format), format)
