"""Both clients against the real service, and against answers that no service of ours gives."""

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.client import (
    PROXY_RETRIES,
    RETRIES,
    AsyncClient,
    Client,
    ClientError,
    ProblemError,
    UnexpectedAnswerError,
    UnreachableError,
)
from service.errors import PROBLEMS
from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX
from service.search.schemas import SearchOptions
from tests.core.io.step_files import step_assembly, step_box
from tests.service.cli.awaited import Awaited
from tests.service.cli.conftest import mesh_bytes
from tests.service.jobs.support import pack

CUP = ("cup-0.off", mesh_bytes("cup", 0))
OCTOPUS = ("octopus-0.off", mesh_bytes("octopus", 0))

Make = Callable[..., Client]
Answering = Callable[[Callable[[httpx.Request], httpx.Response]], Client]


@pytest.fixture(params=[Client, Awaited], ids=["waiting", "awaited"])
def make(request: pytest.FixtureRequest) -> Make:
    """A maker of clients: one that waits, or one whose answers are awaited."""
    return request.param


@pytest.fixture
def archive(archive: Client) -> Iterator[Awaited]:
    """An asynchronous client of a running service that holds nothing; the commands' tests use the other."""
    with Awaited(archive.url) as client:
        yield client


def test_the_parts_of_an_assembly(archive: Awaited) -> None:
    first = archive.upload(("pair.step", step_assembly()), split="parts")
    assert (first.shape.name, first.created) == ("pair.step", True)
    (box,) = first.parts
    assert (box.shape.name, box.created, box.shape.metadata["instances"]) == ("pair.step/box", True, 2)
    again = archive.upload(("pair.step", step_assembly()), split="parts")
    assert (again.created, [part.created for part in again.parts]) == (False, [False])
    assert again.parts[0].shape.id == box.shape.id
    assert archive.upload(("box.step", step_box()), split="parts").parts == ()
    assert archive.upload(("pair.step", step_assembly())).parts == ()
    assert [shape.id for shape in archive.shapes(metadata={"assembly": "pair.step"})] == [box.shape.id]


def test_a_shape_from_upload_to_deletion(archive: Awaited) -> None:
    first = archive.upload(CUP, tags=["cup", "small"], metadata={"year": 2024})
    assert first.created
    assert (first.shape.name, first.shape.tags) == ("cup-0.off", ["cup", "small"])
    again = archive.upload(CUP)
    assert not again.created
    assert again.shape == first.shape
    assert archive.shape(first.shape.id) == first.shape
    assert archive.file(first.shape.id) == CUP[1]
    changed = archive.update(first.shape.id, name="mug", tags=[], metadata={})
    assert (changed.name, changed.tags, changed.metadata) == ("mug", [], {})
    assert archive.update(first.shape.id, tags=["x"]).name == "mug"
    archive.delete(first.shape.id)
    with pytest.raises(ProblemError) as missing:
        archive.shape(first.shape.id)
    assert (missing.value.kind, missing.value.problem.status) == ("shape-not-found", 404)


def test_a_path_is_uploaded_under_its_name(archive: Awaited, tmp_path: Path) -> None:
    path = tmp_path / "from disk.off"
    path.write_bytes(CUP[1])
    assert archive.upload(path).shape.name == "from disk.off"
    assert archive.upload(str(path), name="another").shape.name == "another"


def test_a_job_from_sending_to_deletion(archive: Awaited, tmp_path: Path) -> None:
    path = tmp_path / "meshes.zip"
    path.write_bytes(pack({"a/cup.off": CUP[1], "octopus.off": OCTOPUS[1], "words.off": b"x"}))
    sent = archive.send_archive(path, tags=["x", "y"], metadata={"year": 2026})
    assert (sent.archive, sent.bytes) == ("meshes.zip", path.stat().st_size)
    # The runner may have begun before the answer was read from the database.
    assert sent.state in {"waiting", "running"}
    *_, last = archive.follow_job(sent.id, seconds=0.1)
    assert (last.state, last.counts.stored, last.counts.refused) == ("done", 2, 1)
    assert [file.path for file in archive.job_files(sent.id)] == ["a/cup.off", "octopus.off", "words.off"]
    (bad,) = archive.job_files(sent.id, outcome="refused")
    assert bad.problem is not None
    assert bad.problem.type == TYPE_PREFIX + "malformed-mesh"
    for file in archive.job_files(sent.id, outcome="stored"):
        assert file.shape_id is not None
        shape = archive.shape(file.shape_id)
        assert (shape.tags, shape.metadata) == (["x", "y"], {"year": 2026})
    other = archive.send_archive(("other.zip", path.read_bytes()))
    assert [job.id for job in archive.jobs()][:2] == [other.id, sent.id]
    assert archive.cancel_job(other.id).has_ended
    archive.delete_job(sent.id)
    with pytest.raises(ProblemError) as missing:
        archive.job(sent.id)
    assert missing.value.kind == "job-not-found"


def test_problems_name_their_cause(archive: Awaited) -> None:
    for file, kind in ((("x.off", b""), "empty-file"), (("x.docx", b"x"), "unknown-format")):
        with pytest.raises(ProblemError) as refused:
            archive.query_file(file)
        assert refused.value.kind == kind
    with pytest.raises(ProblemError) as refused:
        archive.query_file(CUP, top_k=1000)
    assert refused.value.problem.errors is not None
    assert [fault.field for fault in refused.value.problem.errors] == ["top_k"]


def test_an_id_names_no_other_address(archive: Awaited) -> None:
    for shape_id in ("../version", "a/b", "?limit=1", "%2e%2e"):
        with pytest.raises(ProblemError) as refused:
            archive.shape(shape_id)
        assert refused.value.problem.status == 404


@pytest.mark.parametrize("url", ["http://127.0.0.1:9", "ftp://127.0.0.1", "nothing", "http://[::1"])
def test_unreachable(url: str, make: Make) -> None:
    with pytest.raises(UnreachableError), make(url) as client:
        client.version()


def test_unreachable_is_not_ready(make: Make) -> None:
    with make("http://127.0.0.1:9") as client:
        assert not client.ready()


@pytest.fixture
def answering(make: Make) -> Answering:
    """A maker of clients that have their answers from a function."""
    return lambda handler: make("http://elsewhere", transport=httpx.MockTransport(handler))


@pytest.mark.parametrize(
    "given",
    [
        {"status_code": 200, "text": "<html>hello</html>"},
        {"status_code": 200, "json": {"version": "1.0", "service": "another"}},
        {"status_code": 502, "text": "Bad gateway"},
        {"status_code": 500, "json": {"detail": "x"}, "headers": {"content-type": MEDIA_TYPE}},
        {"status_code": 302, "headers": {"location": "/login"}},
    ],
)
def test_another_service_is_told_apart(given: dict[str, Any], answering: Answering) -> None:
    with (
        answering(lambda request: httpx.Response(**given)) as client,
        pytest.raises(UnexpectedAnswerError, match="/version"),
    ):
        client.version()


def problem(kind: str) -> httpx.Response:
    row = PROBLEMS[kind]
    body = {
        "type": TYPE_PREFIX + kind,
        "title": row.title,
        "status": row.status,
        "detail": "for the test",
        "instance": "urn:isoshape:request:1",
        "request_id": "1",
    }
    headers = {"content-type": MEDIA_TYPE, "retry-after": "0"}
    return httpx.Response(row.status, json=body, headers=headers)


@pytest.mark.parametrize(
    ("refusal", "times"),
    [
        *((kind, 1 + RETRIES[kind]) for kind in ("busy", "not-ready", "worker-lost", "storage-unavailable")),
        *((kind, 1) for kind in ("storage-full", "no-triangles")),
        *((status, 1 + PROXY_RETRIES * (status != 502)) for status in (429, 503, 502)),
    ],
)
def test_only_what_may_pass_is_tried_again_and_not_for_ever(
    refusal: str | int, times: int, answering: Answering
) -> None:
    """A service answers with a problem, a proxy with a status and a page of its own."""
    asked = []

    def refuse(request: httpx.Request) -> httpx.Response:
        asked.append(request)
        if isinstance(refusal, str):
            return problem(refusal)
        return httpx.Response(refusal, text="<html>later</html>", headers={"retry-after": "0"})

    with answering(refuse) as client, pytest.raises(ClientError) as refused:
        client.delete("x")
    if isinstance(refusal, str):
        assert isinstance(refused.value, ProblemError)
        assert refused.value.kind == refusal
    else:
        assert isinstance(refused.value, UnexpectedAnswerError)
        assert str(refusal) in str(refused.value)
    assert len(asked) == times


@pytest.mark.parametrize("method", ["upload", "send_archive"])
def test_a_service_that_was_busy_gets_the_whole_file_again(
    method: str, answering: Answering, tmp_path: Path
) -> None:
    """An archive is streamed, and begins anew."""
    path = tmp_path / "meshes.zip"
    path.write_bytes(bytes(range(256)) * 1000)
    bodies: list[bytes] = []

    def busy_once(request: httpx.Request) -> httpx.Response:
        bodies.append(request.read())
        return problem("busy" if len(bodies) == 1 else "bad-request")

    with answering(busy_once) as client, pytest.raises(ProblemError):
        getattr(client, method)(path)
    assert len(bodies) == 2
    assert all(path.read_bytes() in body for body in bodies)


def test_retried_kinds_are_temporary_ones() -> None:
    assert {PROBLEMS[kind].status for kind in RETRIES} == {429, 503}


def test_a_query_has_the_options_of_the_service() -> None:
    with Client("http://elsewhere") as client:
        for method in (client.query_file, client.query_shape, client.similar):
            assert set(SearchOptions.model_fields) <= set(inspect.signature(method).parameters)
        with pytest.raises(TypeError, match="no option 'topk'"):
            client.query_file(CUP, topk=1)


def test_both_have_the_same_methods() -> None:
    def describe(client: Client | AsyncClient) -> dict[str, object]:
        public = {name: getattr(client, name) for name in dir(client) if name[0] != "_" and name != "url"}
        return {name: (list(parameters(each)), inspect.getdoc(each)) for name, each in public.items()}

    def parameters(method: Callable[..., object]) -> Iterator[tuple[str, object, object]]:
        for each in inspect.signature(method).parameters.values():
            yield each.name, each.kind, each.default

    client = Client("http://elsewhere")
    assert describe(AsyncClient("http://elsewhere")) == describe(client)
    assert list(inspect.signature(client.shape).parameters) == ["shape_id"]
    assert inspect.getdoc(client.shape) == inspect.getdoc(Client.shape) == "Get the record of a shape."
