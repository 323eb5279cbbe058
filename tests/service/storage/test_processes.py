"""Real server processes: killed, restarted, and two on one archive."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import httpx

from tests.service.engines import on_both, url_in
from tests.service.support import query, small_file, upload, wait_until

WRITERS = 8
TURNS = 2


@contextmanager
def server(
    folder: Path, *, seconds: float = 180, **settings: str
) -> Iterator[tuple[subprocess.Popen[bytes], httpx.Client]]:
    """`isoshape serve` on a folder's archive, ready in some seconds; killed at the end if it still runs.

    It has one worker unless the settings say otherwise.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ISOSHAPE_")} | {
        "ISOSHAPE_DATABASE_URL": url_in(folder),
        "ISOSHAPE_WORKERS": "1",
        **settings,
    }
    command = [sys.executable, "-P", "-m", "service.cli", "serve", "--port", str(port)]
    with (folder / "log.txt").open("ab") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=120) as client:
            wait_until(lambda: answers(client) or process.poll() is not None, seconds=seconds)
            assert process.poll() is None, f"the service ended: {(folder / 'log.txt').read_text()}"
            yield process, client
    finally:
        process.kill()
        process.wait()


def answers(client: httpx.Client) -> bool:
    """Whether the service is ready."""
    try:
        return client.get("/readyz").status_code == 200
    except httpx.TransportError:
        return False


def workers(process: subprocess.Popen[bytes]) -> list[int]:
    """The children of a process, which the system lists by the thread that started each."""
    threads = Path(f"/proc/{process.pid}/task").iterdir()
    return [int(pid) for thread in threads for pid in (thread / "children").read_text().split()]


@on_both
def test_a_killed_service_has_all_that_it_had_acknowledged(tmp_path: Path) -> None:
    acknowledged: dict[str, str] = {}
    deleted: set[str] = set()
    stop = threading.Event()

    def send(client: httpx.Client, start: int) -> None:
        number = start
        while not stop.is_set():
            try:
                answer = upload(client, small_file(number), f"{number}.off", tags=str(number))
            except httpx.TransportError:
                return
            if answer.status_code == 201:
                acknowledged[answer.json()["id"]] = str(number)
                if number % 5 == 0:
                    gone = answer.json()["id"]
                    try:
                        if client.delete(f"/shapes/{gone}").status_code == 204:
                            deleted.add(gone)
                    except httpx.TransportError:
                        acknowledged.pop(gone)
                        return
            number += 3

    with server(tmp_path) as (process, client):
        threads = [threading.Thread(target=send, args=(client, start)) for start in range(3)]
        for thread in threads:
            thread.start()
        wait_until(lambda: len(acknowledged) >= 12, seconds=60)
        orphans = workers(process)
        assert len(orphans) >= 2
        process.send_signal(signal.SIGKILL)
        process.wait()
        stop.set()
        for thread in threads:
            thread.join()
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in orphans), seconds=30)
    expected = {shape_id: name for shape_id, name in acknowledged.items() if shape_id not in deleted}
    assert expected
    assert deleted
    with server(tmp_path) as (process, client):
        page = client.get("/shapes", params={"limit": 500}).json()
        stored = {shape["id"]: shape for shape in page["shapes"]}
        assert set(expected) <= set(stored)
        assert not deleted & set(stored)
        for shape_id, number in expected.items():
            assert stored[shape_id]["tags"] == [number]
            assert client.get(f"/shapes/{shape_id}/file").content == small_file(int(number))
        answer = query(client, small_file(int(number)), top_k=1).json()
        assert answer["compared"] == answer["stored"] == len(stored)
        assert answer["results"][0]["shape"]["id"] == shape_id
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) in {0, -signal.SIGTERM}


@on_both
def test_two_services_see_each_others_writes_and_many_writers_on_them_lose_nothing(tmp_path: Path) -> None:
    settings = {"ISOSHAPE_LOCK_SECONDS": "60"}
    with server(tmp_path, **settings) as (_, one), server(tmp_path, **settings) as (_, other):
        clients = (one, other)
        for number in range(4):
            there, here = (one, other) if number % 2 else (other, one)
            shape = upload(here, small_file(number), f"{number}.off").json()
            answer = query(there, small_file(number), top_k=1).json()
            assert answer["results"][0]["shape"]["id"] == shape["id"]
            assert answer["stored"] == number + 1
        assert one.delete(f"/shapes/{shape['id']}").status_code == 204
        answer = query(other, small_file(number), top_k=10).json()
        assert answer["compared"] == answer["stored"] == 3
        assert shape["id"] not in {result["shape"]["id"] for result in answer["results"]}
        for result in answer["results"]:
            assert other.delete(f"/shapes/{result['shape']['id']}").status_code == 204

        def done(answer: httpx.Response, *statuses: int) -> httpx.Response:
            assert answer.status_code in statuses, answer.text
            return answer

        def write(writer: int) -> tuple[bool, dict[str, int]]:
            """Some shapes, each on bytes that others store too; the first of them deleted again."""
            client = clients[writer % 2]
            made: dict[str, int] = {}
            was_first = done(upload(client, small_file(0), "common.off"), 200, 201).status_code == 201
            for turn in range(TURNS):
                data = small_file((writer + turn) % 5)
                shape = done(upload(client, data, f"{writer} {turn}.off"), 201).json()
                made[shape["id"]] = turn
                address = f"/shapes/{shape['id']}"
                done(client.patch(address, json={"metadata": {"writer": writer, "turn": turn}}), 200)
            done(client.delete(f"/shapes/{next(iter(made))}"), 204)
            return was_first, dict(list(made.items())[1:])

        with ThreadPoolExecutor(WRITERS) as pool:
            outcomes = list(pool.map(write, range(WRITERS)))
        assert sum(was_first for was_first, _ in outcomes) == 1
        expected = {
            shape_id: {"writer": writer, "turn": turn}
            for writer, (_, made) in enumerate(outcomes)
            for shape_id, turn in made.items()
        }
        for client in clients:
            shapes = client.get("/shapes", params={"limit": 500}).json()["shapes"]
            assert {
                each["id"]: each["metadata"] for each in shapes if each["name"] != "common.off"
            } == expected
            assert len(shapes) == len(expected) + 1
            answer = query(client, small_file(9), top_k=100).json()
            assert answer["compared"] == answer["stored"] == len(shapes)
            assert {each["shape"]["id"] for each in answer["results"]} == {each["id"] for each in shapes}


def test_a_service_does_not_start_with_a_setting_it_does_not_know(tmp_path: Path) -> None:
    environment = {**os.environ, "ISOSHAPE_WORKER": "2", "ISOSHAPE_DATABASE": "x"}
    done = subprocess.run(
        [sys.executable, "-m", "uvicorn", "--factory", "service.app:app_from_environment", "--port", "0"],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode != 0
    assert "unknown settings: ISOSHAPE_DATABASE, ISOSHAPE_WORKER;" in done.stderr
    assert list(tmp_path.iterdir()) == []
