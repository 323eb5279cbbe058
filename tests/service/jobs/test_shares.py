"""Jobs and event streams of one key, and room and turns for those of another."""

import threading
from collections.abc import Iterator

import httpx
import pytest

from service.auth.keys import digest_of
from service.compute import request_queue
from service.jobs import endpoints
from service.shapes import service as shapes_service
from tests.service.jobs.support import begun, ended, has_stored, job, pack, send
from tests.service.support import Running, assert_problem, module_service, small_file, wait_until

FIRST, SECOND, THIRD = "isoshape_first", "isoshape_second", "isoshape_third"
MAX_JOBS = 8

running = module_service(
    key=FIRST, workers=2, max_jobs=MAX_JOBS, api_keys=tuple(map(digest_of, (FIRST, SECOND, THIRD)))
)


def archive(name: str, files: int) -> bytes:
    """Return a zip of files whose names begin with that of a client."""
    return pack({f"{name} {number}.off": small_file(number) for number in range(files)})


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Shapes of the first client are stored only when this is set."""
    go_on = threading.Event()
    store = shapes_service._store

    def wait_and_store(*arguments: object) -> object:
        if arguments[2][0].name.startswith("first"):  # type: ignore[index]
            go_on.wait(300)
        return store(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(shapes_service, "_store", wait_and_store)
    # Jobs wait no longer for workers that requests need.
    monkeypatch.setattr(request_queue, "PATIENCE_SECONDS", 0.1)
    yield go_on
    go_on.set()


@pytest.fixture
def others(running: Running) -> Iterator[list[httpx.Client]]:
    """Clients with the other keys. All jobs are deleted afterwards."""
    clients = [
        httpx.Client(base_url=running.client.base_url, headers={"x-api-key": key}, timeout=120)
        for key in (SECOND, THIRD)
    ]
    yield clients
    for each in running.client.get("/jobs").json()["jobs"]:
        assert running.client.delete(f"/jobs/{each['id']}").status_code == 204
    for client in clients:
        client.close()


def until_refused(client: httpx.Client, name: str) -> list[str]:
    """Send archives until the service is busy; the ids of the jobs."""
    ids = []
    while (answer := send(client, archive(name, 3))).status_code == 202:
        ids.append(answer.json()["id"])
    assert_problem(answer, 503, "busy")
    return ids


def test_each_client_has_room_for_jobs_and_its_files_have_turns(
    running: Running, others: list[httpx.Client], held: threading.Event
) -> None:
    own = until_refused(running.client, "first")
    assert len(own) == MAX_JOBS // 2
    wait_until(lambda: running.server.config.app.state.runner.active_members == 2, seconds=60)
    # While all files of the first client stand still at their end, those of others go on.
    second = until_refused(others[0], "second")
    assert len(second) == MAX_JOBS // 4
    third = begun(others[1], archive("third", 3))
    for job_id in (*second, third):
        assert ended(running.client, job_id)["counts"]["files"] == 3
        assert job(running.client, job_id)["state"] == "done"
    assert job(running.client, own[0])["counts"]["stored"] == 0
    assert [job(running.client, each)["state"] for each in own] == ["running", *["waiting"] * 3]
    held.set()
    for job_id in own:
        assert ended(running.client, job_id)["state"] == "done"
    assert ended(running.client, begun(running.client, archive("first", 4)))["counts"]["stored"] == 1


def test_jobs_of_several_clients_run_at_a_time(
    running: Running, others: list[httpx.Client], held: threading.Event
) -> None:
    """Both clients have long jobs, of which neither waits for the end of the other."""
    held.set()
    clients = [running.client, others[0]]
    ids = [begun(client, archive(f"long {number}", 40)) for number, client in enumerate(clients)]
    for number in (5, 10, 15):
        for job_id in ids:
            wait_until(
                lambda job_id=job_id, number=number: has_stored(running.client, job_id, number), seconds=120
            )
        assert not any(job(running.client, job_id)["ended_at"] for job_id in ids)


def test_each_client_has_room_for_streams(
    running: Running, others: list[httpx.Client], held: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoints, "FOLLOWERS", 8)
    job_id = begun(running.client, archive("first stream", 1))
    open_streams: list[httpx.Response] = []
    for client, share in zip((running.client, *others), (4, 2, 1), strict=True):
        request = client.build_request("GET", f"/jobs/{job_id}/events")
        before = len(open_streams)
        while (stream := client.send(request, stream=True)).status_code == 200:
            open_streams.append(stream)
        stream.read()
        assert_problem(stream, 503, "busy")
        assert len(open_streams) - before == share
    followers = running.server.config.app.state.runner.followers
    assert followers.total() == 7
    held.set()
    for stream in open_streams:
        assert "event: end" in stream.read().decode()
    wait_until(lambda: not followers, seconds=60)
