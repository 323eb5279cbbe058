"""Jobs of real server processes that are killed, stopped, or two on one archive."""

import signal
import threading
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from service.storage.checking import check
from tests.service.archives import opened
from tests.service.jobs.support import begun, ended, events, files, has_stored, pack
from tests.service.processes import server
from tests.service.support import small_file, wait_until

GOOD = {f"{number}.off": small_file(number) for number in range(16)}


def broken(whole: bytes) -> dict[str, tuple[bytes, str]]:
    """Files that are refused, each with why it is, by a sound OFF."""
    return {
        "broken/half.off": (whole[: len(whole) // 2], "malformed-mesh"),
        "broken/empty.ply": (b"", "empty-file"),
        "broken/nan.off": (b"OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n", "non-finite-coordinates"),
        "broken/points.off": (b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "no-triangles"),
        "broken/notes.txt": (b"x", "unknown-format"),
        "../outside.off": (whole, "member-name"),
    }


BAD = broken(GOOD["0.off"])


def mixed(good: Mapping[str, bytes], bad: Mapping[str, tuple[bytes, str]]) -> bytes:
    """A zip of all, the bad files spread among the good ones."""
    paths = list(good)
    for place, path in enumerate(bad):
        paths.insert((place + 1) * len(good) // (len(bad) + 1) + place, path)
    return pack({path: good[path] if path in good else bad[path][0] for path in paths})


def assert_all_there(
    client: httpx.Client,
    folder: Path,
    job_id: str,
    good: Mapping[str, bytes] = GOOD,
    bad: Mapping[str, tuple[bytes, str]] = BAD,
    seconds: float = 300,
) -> None:
    """Every good file is stored once and named by its outcome, every bad one refused with its cause."""
    done = ended(client, job_id, seconds)
    assert done["state"] == "done"
    counts = {"waiting": 0, "stored": len(good), "present": 0, "refused": len(bad)}
    counts["ignored"] = [kind for _, kind in bad.values()].count("unknown-format")
    assert done["counts"] == {"files": len(good) + len(bad), **counts}
    shapes = client.get("/shapes", params={"limit": 500}).json()["shapes"]
    names = {shape["id"]: shape["name"] for shape in shapes}
    causes = {}
    for file in files(client, job_id):
        if file["outcome"] == "stored":
            assert names.pop(file["shape_id"]) == Path(file["path"]).name
            assert client.get(f"/shapes/{file['shape_id']}/file").content == good[file["path"]]
        else:
            causes[file["path"]] = file["problem"]["type"].rpartition(":")[2]
    assert names == {}
    assert causes == {path: kind for path, (_, kind) in bad.items()}
    assert check(folder / "archive.sqlite3", lock_seconds=10).faults == []


def test_a_job_of_a_service_that_is_killed_again_and_again_and_then_asked_to_stop(tmp_path: Path) -> None:
    with server(tmp_path) as (process, client):
        job_id = begun(client, mixed(GOOD, BAD))
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
        assert_all_there(client, tmp_path, job_id)


def test_a_service_takes_over_the_job_of_another_that_died(tmp_path: Path) -> None:
    with server(tmp_path) as (process, one), server(tmp_path, shared=True) as (_, other):
        job_id = begun(one, mixed(GOOD, BAD))
        wait_until(partial(has_stored, other, job_id, 2), seconds=300)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert_all_there(other, tmp_path, job_id)
