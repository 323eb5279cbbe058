"""Changed files over HTTP: taken or refused by name of their fault, and what is taken reads back as a shape.

What was stored must have finite numbers, and indices that refer to something; `isoshape check` of the archive
must find nothing. `COUNT` files are sent, of the seed `SEED`.
"""

import io
import math
import os
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest
import trimesh

from core.io import read_mesh, write_mesh
from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX
from service.storage.checking import check
from tests.core.io.mutation import mutation, sources
from tests.soak.hostile.conftest import Served

COUNT, SEED = int(os.environ.get("COUNT") or 60), int(os.environ.get("SEED") or 0)
AT_A_TIME = 4
REFUSALS = {
    "empty-file",
    "malformed-mesh",
    "non-finite-coordinates",
    "no-triangles",
    "degenerate-mesh",
    "mesh-too-complex",
    "external-reference",
    "file-time-limit",
}


def fault_in_mesh(facts: Mapping[str, float], data: bytes, format: str) -> str:
    """The fault of a stored mesh that the service has written, by trimesh; "" without a fault."""
    try:
        mesh = trimesh.load(io.BytesIO(data), file_type=format, process=False, maintain_order=True)
        vertices, faces = mesh.vertices, mesh.faces
    except Exception as error:
        return f"the mesh is no {format}: {error!r}; {data[:100]!r}"
    if (len(vertices), len(faces)) != (facts["vertices"], facts["faces"]):
        return f"{len(vertices)} vertices and {len(faces)} faces are stored, and the facts are {facts}"
    if not np.isfinite(vertices).all():
        return "a coordinate is not finite"
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        return f"a face has a corner outside 0 .. {len(vertices)} - 1"
    return ""


def fault_in_embedding(facts: Mapping[str, float], npz: bytes) -> str:
    """The fault of a stored shape, by its facts and the arrays of its embedding; "" without a fault."""
    if not all((np.isfinite(value) & (np.asarray(value) >= 0)).all() for value in facts.values()):
        return f"facts {facts}"
    if not (facts["area"] > 0 and facts["scale"] > 0 and facts["faces"] >= 1 and facts["vertices"] >= 3):
        return f"no surface: {facts}"
    with np.load(io.BytesIO(npz), allow_pickle=False) as arrays:
        found = dict(arrays)
    for name, array in found.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return f"{name} holds a number that is not finite"
    samples = len(found["positions"])
    bounds = dict.fromkeys(("graph_edges", "tree_edges", "regions"), samples)
    for name, bound in {**bounds, "vertices": facts["vertices"]}.items():
        if found[name].size and not (found[name].min() >= 0 and found[name].max() < bound):
            return f"{name} holds an index outside 0 .. {bound} - 1"
    lengths = (samples, len(found["vertices"]), len(found["tree_edges"]) + 1)
    if samples == 0 or len(set(lengths)) > 1:
        return f"samples, vertices and edges of the tree do not fit together: {lengths}"
    return ""


def judged(client: httpx.Client, filename: str, data: bytes) -> tuple[str, str]:
    """A name for the answer, and what is wrong with it or with what was stored; "" if nothing is."""
    try:
        answer = client.post("/shapes", files={"file": (filename, data)})
    except httpx.TimeoutException:
        return "none", "no answer in time"
    if answer.status_code == 201:
        facts, address = answer.json()["facts"], answer.headers["location"]
        npz = client.get(f"{address}/embedding", params={"format": "npz"}).content
        # In the format of the upload it would be the upload.
        other = "obj" if filename.endswith("off") else "off"
        mesh = client.get(f"{address}/file", params={"format": other}).content
        return "stored", fault_in_embedding(facts, npz) or fault_in_mesh(facts, mesh, other)
    if answer.headers.get("content-type") != MEDIA_TYPE:
        return str(answer.status_code), f"{answer.status_code} without a problem document"
    kind = answer.json()["type"].removeprefix(TYPE_PREFIX)
    return kind, "" if answer.status_code == 422 and kind in REFUSALS else answer.text


def test_changed_files_are_taken_or_refused(served: Served) -> None:
    # Made before the threads begin: fast-simplification works in one thread at a time.
    sound = sources()

    def send(number: int) -> tuple[str, str]:
        format, data = mutation(sound, SEED, number)
        return judged(served.client, f"{number}.{format}", data)

    with ThreadPoolExecutor(AT_A_TIME) as threads:
        outcomes = list(threads.map(send, range(COUNT)))
    answers = Counter(answer for answer, _ in outcomes)
    print(f"{COUNT} changed files, seed {SEED}: {dict(answers.most_common())}")
    assert [f"file {number}: {fault}" for number, (_, fault) in enumerate(outcomes) if fault] == []
    report = check(served.folder / "archive.sqlite3", lock_seconds=10)
    assert report.faults == []
    assert 0 < report.shapes == served.client.get("/shapes").json()["total"] == answers["stored"]
    assert answers["malformed-mesh"] > 0


def test_a_wrong_embedding_would_be_seen(served: Served) -> None:
    format, data = sources()[0]
    answer = served.client.post("/shapes", files={"file": (f"sound.{format}", data)})
    facts = answer.json()["facts"]
    npz = served.client.get(answer.headers["location"] + "/embedding", params={"format": "npz"}).content
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
    assert "nan" in fault_in_embedding({**facts, "volume": math.nan}, npz)


@pytest.mark.parametrize("format", ["off", "obj"])
def test_a_wrong_mesh_would_be_seen(format: str) -> None:
    mesh = read_mesh(sources()[0][1], sources()[0][0])
    facts = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    sound = write_mesh(mesh, format)
    assert fault_in_mesh(facts, sound, format) == ""
    first = repr(float(mesh.vertices[0, 0])).encode()
    assert fault_in_mesh(facts, sound.replace(first, b"nan", 1), format) == "a coordinate is not finite"
    assert "facts" in fault_in_mesh({**facts, "faces": facts["faces"] + 1}, sound, format)
    for broken in (b"", sound[: len(sound) // 2]):
        assert fault_in_mesh(facts, broken, format) != ""
    far = np.where(mesh.faces == 0, len(mesh.vertices), mesh.faces)
    unchecked = type("Unchecked", (), {"vertices": mesh.vertices, "faces": far})
    assert fault_in_mesh(facts, write_mesh(unchecked, format), format) != ""
