"""Jobs of real server processes that are killed, stopped, or two on one archive."""

import signal
import threading
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from service.storage.checking import check
from tests.service.archives import opened
from tests.service.jobs.support import begun, ended, events, files, has_stored, job, pack
from tests.service.processes import server
from tests.service.support import small_file, wait_until

GOOD = {f"{number}.off": small_file(number) for number in range(16)}
BAD = {
    "cut.off": (GOOD["0.off"][:900], "malformed-mesh"),
    "empty.ply": (b"", "empty-file"),
    "../x.off": (GOOD["1.off"], "member-name"),
    "notes.txt": (b"x", "unknown-format"),
    "words.stl": (b"no mesh", "malformed-mesh"),
}


def mixed() -> dict[str, bytes]:
    """The good files with a bad one after every third."""
    found: dict[str, bytes] = {}
    bad = iter(BAD)
    for number, (name, data) in enumerate(GOOD.items()):
        found[name] = data
        if number % 3 == 0 and number // 3 < len(BAD):
            path = next(bad)
            found[path] = BAD[path][0]
    assert len(found) == len(GOOD) + len(BAD)
    return found


def assert_all_there(client: httpx.Client, folder: Path, job_id: str) -> None:
    """Every good file is stored once and named by its outcome, every bad one refused with its cause."""
    done = job(client, job_id)
    assert done["state"] == "done"
    assert done["counts"] == {"files": 21, "waiting": 0, "stored": 16, "present": 0, "refused": 5}
    shapes = client.get("/shapes", params={"limit": 500}).json()["shapes"]
    by_id = {shape["id"]: shape["name"] for shape in shapes}
    assert sorted(by_id.values()) == sorted(GOOD)
    told: dict[str, Any] = {}
    for file in files(client, job_id):
        cause = file["problem"] and file["problem"]["type"].rpartition(":")[2]
        told[file["path"]] = by_id.get(file["shape_id"], cause)
    assert told == {**{name: name for name in GOOD}, **{path: kind for path, (_, kind) in BAD.items()}}
    for shape_id, name in by_id.items():
        assert client.get(f"/shapes/{shape_id}/file").content == GOOD[name]
    assert check(folder / "archive.sqlite3", lock_seconds=10).faults == []


def test_a_job_of_a_service_that_is_killed_again_and_again_and_then_asked_to_stop(tmp_path: Path) -> None:
    with server(tmp_path) as (process, client):
        job_id = begun(client, pack(mixed()))
        # Acknowledged, so it is there whatever happens next.
        process.send_signal(signal.SIGKILL)
        process.wait()
    with server(tmp_path) as (process, client):
        wait_until(partial(has_stored, client, job_id, 3), seconds=300)
        process.send_signal(signal.SIGKILL)
        process.wait()
    with opened(tmp_path / "archive.sqlite3") as connection:
        outcomes = [outcome for (outcome,) in connection.execute("SELECT outcome FROM job_files")]
    stored = outcomes.count("stored")
    assert stored >= 3
    assert outcomes.count(None) > 0
    told: list[Any] = []

    def follow(client: httpx.Client) -> None:
        with client.stream("GET", f"/jobs/{job_id}/events") as answer:
            told.extend(events(answer.iter_lines()))

    # With so much patience the open stream would hold up the end, were it not ended.
    with server(tmp_path, ISOSHAPE_SHUTDOWN_SECONDS="600") as (process, client):
        following = threading.Thread(target=follow, args=(client,))
        following.start()
        wait_until(partial(has_stored, client, job_id, stored + 1), seconds=300)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=180) in {0, -signal.SIGTERM}
        following.join()
    assert told
    assert {name for _, name, _ in told} == {"progress"}
    assert '"level": "error"' not in (tmp_path / "log.txt").read_text()
    with server(tmp_path) as (_, client):
        ended(client, job_id)
        assert_all_there(client, tmp_path, job_id)


def test_a_service_takes_over_the_job_of_another_that_died(tmp_path: Path) -> None:
    with server(tmp_path) as (process, one), server(tmp_path, shared=True) as (_, other):
        job_id = begun(one, pack(mixed()))
        wait_until(partial(has_stored, other, job_id, 2), seconds=300)
        process.send_signal(signal.SIGKILL)
        process.wait()
        ended(other, job_id)
        assert_all_there(other, tmp_path, job_id)
