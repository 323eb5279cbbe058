"""A service that is killed again and again while clients write: nothing acknowledged may be lost.

`CYCLES` kills on SQLite, and two on PostgreSQL. `SEED` decides their moments, and what is written.
"""

import json
import os
import random
import signal
import statistics
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import httpx

from service.storage.checking import check
from service.storage.sqlite import has_journal
from tests.service.engines import SQLITE, on_both
from tests.service.processes import children, runs, server
from tests.service.support import small_file, wait_until
from tests.soak.kill.ledger import Ledger, Sent

CYCLES, SEED = int(os.environ.get("CYCLES") or 2), int(os.environ.get("SEED") or 0)
CLIENTS, MOST_ACKNOWLEDGED = 4, 24
KEPT = 8
"""Beyond so many shapes clients delete as well."""
KNOWN = 6
"""Files that every client uploads again and again, under new names: with no embedding to wait for, the
service is mostly in the middle of a write."""
# Generous: the kills are run beside other work, and at low priority.
LOAD_SECONDS, START_SECONDS, ORPHAN_SECONDS = 120.0, 900.0, 60.0


class Client(threading.Thread):
    """Uploads and deletes until the service is gone."""

    def __init__(self, url: str, ledger: Ledger, name: str) -> None:
        super().__init__(name=name)
        self._url = url
        self._ledger = ledger
        self._draw = random.Random(name)
        self.faults: list[str] = []

    def run(self) -> None:
        with httpx.Client(base_url=self._url, timeout=60) as http:
            count = 0
            while not self.faults:
                try:
                    self.upload(http, f"{self.name}-{count}.off")
                    self.delete(http)
                except httpx.TransportError:
                    return
                except Exception as error:
                    self.faults.append(repr(error))
                count += 1

    def upload(self, http: httpx.Client, name: str) -> None:
        new = self._draw.random() < 0.3
        number = self._draw.randrange(KNOWN, 10**6) if new else self._draw.randrange(KNOWN)
        sent = Sent(name, small_file.__wrapped__(number), f"tag {number}", {"number": number})
        self._ledger.send(sent)
        fields = {"tags": sent.tag, "metadata": json.dumps(sent.metadata)}
        answer = http.post("/shapes", files={"file": (name, sent.data)}, data=fields)
        if self._acknowledged(answer, 201):
            self._ledger.stored(name, answer.json()["id"])

    def delete(self, http: httpx.Client) -> None:
        shape_id = self._ledger.take(KEPT) if self._draw.random() < 0.9 else None
        if shape_id is not None and self._acknowledged(http.delete(f"/shapes/{shape_id}"), 204):
            self._ledger.deleted(shape_id)

    def _acknowledged(self, answer: httpx.Response, status: int) -> bool:
        if answer.status_code not in {status, 503}:
            self.faults.append(f"{answer.request.method}: {answer.status_code} {answer.text}")
        return answer.status_code == status


class Cycle(NamedTuple):
    """How long the service started, how long its workers outlived it, and whether a write was half done."""

    start_seconds: float
    orphan_seconds: float
    journal: bool


def run_cycle(folder: Path, ledger: Ledger, seed: int) -> Cycle:
    """Start the service, verify what is there, let clients write, and kill it at a drawn moment.

    The moment is so many acknowledgements after the first request, and then some milliseconds.
    """
    draw = random.Random(seed)
    began = time.monotonic()
    with server(folder, seconds=START_SECONDS) as (process, client):
        started = time.monotonic() - began
        verify(client, folder, ledger)
        workers = children(process.pid)
        assert len(workers) >= 2
        enough = ledger.acknowledged + draw.randint(0, MOST_ACKNOWLEDGED)
        clients = [Client(str(client.base_url), ledger, f"{seed}-{number}") for number in range(CLIENTS)]
        for each in clients:
            each.start()
        wait_until(
            lambda: ledger.acknowledged >= enough or any(each.faults for each in clients),
            seconds=LOAD_SECONDS,
        )
        time.sleep(draw.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        process.wait()
        for each in clients:
            each.join()
        assert [fault for each in clients for fault in each.faults] == []
        journal = has_journal(folder / "archive.sqlite3")
        wait_until(lambda: not any(runs(pid) for pid in workers), seconds=ORPHAN_SECONDS)
    return Cycle(started, time.monotonic() - killed, journal)


def verify(client: httpx.Client, folder: Path, ledger: Ledger) -> None:
    """Compare what is there with what was promised; check the archive, its log, every file and the search."""
    shapes = all_shapes(client)
    assert ledger.settle(shapes) == []
    archive = folder / "archive.sqlite3"
    if archive.exists():
        report = check(archive, lock_seconds=10)
        assert (report.faults, report.shapes) == ([], len(shapes))
    for shape in shapes:
        assert client.get(f"/shapes/{shape['id']}/file").content == ledger.data(shape["name"])
    if shapes:
        body = {"shape_id": shapes[-1]["id"], "exclude_self": False, "top_k": 1}
        answer = client.post("/query", json=body).json()
        assert answer["compared"] == answer["stored"] == len(shapes)
    assert '"level": "error"' not in (folder / "log.txt").read_text()


def all_shapes(client: httpx.Client) -> list[dict[str, Any]]:
    shapes: list[dict[str, Any]] = []
    cursor: dict[str, str] = {}
    while cursor is not None:
        page = client.get("/shapes", params={"limit": 500, **cursor}).json()
        shapes += page["shapes"]
        cursor = page["next_cursor"] and {"cursor": page["next_cursor"]}
    return shapes


@on_both
def test_a_killed_service_has_all_that_it_had_acknowledged(tmp_path: Path, engine: str) -> None:
    ledger, began = Ledger(), time.monotonic()
    seeds = range(SEED * 1_000_000, SEED * 1_000_000 + (CYCLES if engine == SQLITE else 2))
    cycles = [run_cycle(tmp_path, ledger, seed) for seed in seeds]
    with server(tmp_path) as (process, client):
        verify(client, tmp_path, ledger)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) in {0, -signal.SIGTERM}
    starts = [cycle.start_seconds for cycle in cycles]
    print(
        f"{len(cycles)} kills in {time.monotonic() - began:.0f} s, seed {SEED}, on {engine}",
        f"{ledger.uploads} uploads and {ledger.deletions} deletions acknowledged: none lost, none torn",
        f"{ledger.found} uploads that were not acknowledged were there, whole",
        f"{sum(cycle.journal for cycle in cycles)} kills in the middle of a commit, rolled back",
        f"ready after {statistics.median(starts):.1f} s (median), {max(starts):.1f} s at most",
        f"workers ended within {max(cycle.orphan_seconds for cycle in cycles):.1f} s of the kill",
        sep="\n* ",
    )
    assert ledger.uploads > 0
