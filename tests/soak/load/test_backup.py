"""A backup that is made while clients write."""

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx

from tests.service.processes import server
from tests.service.support import small_file, upload

KEPT = 10


def command(folder: Path, *arguments: object) -> list[str]:
    """A command on the archive in a folder, in another process; its lines."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "service.cli", *map(str, arguments)],
        env={"ISOSHAPE_DATABASE_URL": f"sqlite:///{folder}/archive.sqlite3", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_backup_made_under_load_gives_the_same_answers_elsewhere(tmp_path: Path) -> None:
    here, there, backup = tmp_path / "here", tmp_path / "there", tmp_path / "backup.sqlite3"
    here.mkdir()
    there.mkdir()
    stop = threading.Event()
    stored: dict[str, int] = {}
    deleted: set[str] = set()

    def load(client: httpx.Client, start: int) -> None:
        number = start
        while not stop.is_set():
            answer = upload(client, small_file(number), f"{number}.off", tags="load")
            assert answer.status_code == 201, answer.text
            stored[answer.json()["id"]] = number
            if number % 2:
                assert client.delete(f"/shapes/{answer.json()['id']}").status_code == 204
                deleted.add(answer.json()["id"])
            number += 2

    with server(here) as (_, client), ThreadPoolExecutor(2) as others:
        kept = [
            upload(client, small_file(number, "stl"), f"{number}.stl", tags="kept")
            for number in range(1000, 1000 + KEPT)
        ]
        assert {answer.status_code for answer in kept} == {201}
        loads = [others.submit(load, client, start) for start in (0, 1)]
        while len(stored) < 4:
            pass
        before, gone = set(stored), set(deleted)
        counts = command(here, "backup", backup)
        stop.set()
        for each in loads:
            each.result()
        assert command(there, "recover", backup) == counts
        with server(there) as (_, restored):
            page = restored.get("/shapes", params={"limit": 500, "tag": "load"}).json()
            present = {shape["id"] for shape in page["shapes"]}
            assert before - deleted <= present <= set(stored) - gone
            # The files of deleted shapes remain until these are erased.
            assert counts[0].startswith(f"{KEPT + len(present)} shapes on ")
            for shape_id in present:
                assert restored.get(f"/shapes/{shape_id}/file").content == small_file(stored[shape_id])
            assert command(there, "check") == counts
            # A probability depends on all stored shapes: both archives come to hold the same.
            for shape_id in set(stored) - deleted:
                assert client.delete(f"/shapes/{shape_id}").status_code == 204
            for shape_id in present:
                assert restored.delete(f"/shapes/{shape_id}").status_code == 204
            answers = [ask(client, answer.json()["id"]) for answer in kept]
            assert [ask(restored, answer.json()["id"]) for answer in kept] == answers


def ask(client: httpx.Client, shape_id: str) -> list[Any]:
    """The results of a query with a stored shape among the kept shapes: a score for each other."""
    answer = client.post("/query", json={"shape_id": shape_id, "top_k": KEPT - 1, "tag": ["kept"]})
    assert answer.status_code == 200, answer.text
    results: list[Any] = answer.json()["results"]
    assert len(results) == KEPT - 1
    return results
