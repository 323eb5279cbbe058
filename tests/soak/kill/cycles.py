"""One cycle: start on what the last kill left, check everything, write, kill."""

import json
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from service.storage.archive_file import has_journal
from service.storage.checking import check
from tests.service.processes import children, server
from tests.service.support import wait_until
from tests.soak.kill.ledger import Ledger
from tests.soak.kill.load import Load

CLIENTS = 4
MOST_ACKNOWLEDGED = 24
# Generous: the kills are run beside other work, and at low priority.
LOAD_SECONDS = 120.0
START_SECONDS = 900.0
ORPHAN_SECONDS = 60.0


@dataclass(frozen=True)
class Cycle:
    """The outcome of one cycle.

    Attributes
    ----------
    start_seconds : float
        From the start of the process until it was ready.
    orphan_seconds : float
        From the kill until the last worker process had ended.
    journal : bool
        Whether the kill left a write half done, which the next start had to roll back.
    faults : list of str
    """

    start_seconds: float
    orphan_seconds: float
    journal: bool
    faults: list[str]


def run_cycle(folder: Path, ledger: Ledger, seed: int) -> Cycle:
    """Start the service, verify what is there, let clients write, and kill it at a drawn moment.

    The moment is so many acknowledgements after the first request, and then some milliseconds.
    """
    draw = random.Random(seed)
    began = time.monotonic()
    with server(folder, seconds=START_SECONDS, ISOSHAPE_WORKERS="1") as (process, client):
        started = time.monotonic() - began
        faults = verify(client, folder, ledger)
        orphans = children(process.pid)
        if not orphans:
            faults.append("no worker processes are seen")
        enough = ledger.acknowledged + draw.randint(0, MOST_ACKNOWLEDGED)
        load = Load(str(client.base_url), ledger, seed, CLIENTS)
        wait_until(lambda: ledger.acknowledged >= enough or load.faults, seconds=LOAD_SECONDS)
        time.sleep(draw.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        process.wait()
        load.join()
        journal = has_journal(folder / "archive.sqlite3")
        try:
            wait_until(lambda: not any(runs(pid) for pid in orphans), seconds=ORPHAN_SECONDS)
        except AssertionError:
            faults.append("worker processes outlive the service")
    return Cycle(started, time.monotonic() - killed, journal, faults + load.faults + logged(folder))


def verify(client: httpx.Client, folder: Path, ledger: Ledger) -> list[str]:
    """Compare what is there with what was promised; check the archive, every file and the search."""
    shapes = all_shapes(client)
    faults = ledger.settle(shapes)
    report = check(folder / "archive.sqlite3", lock_seconds=10)
    faults += [f"isoshape check: {fault}" for fault in report.faults]
    if report.shapes != len(shapes):
        faults.append(f"isoshape check saw {report.shapes} shapes, and the service lists {len(shapes)}")
    for shape in shapes:
        if not faults and client.get(f"/shapes/{shape['id']}/file").content != ledger.data(shape["name"]):
            faults.append(f"{shape['name']} is torn: its file has other bytes")
    if shapes and not faults:
        body = {"shape_id": shapes[-1]["id"], "exclude_self": False, "top_k": 1}
        answer = client.post("/query", json=body).json()
        if not answer["compared"] == answer["stored"] == len(shapes):
            faults.append(f"a query compares {answer['compared']} of {len(shapes)}")
    return faults


def all_shapes(client: httpx.Client) -> list[dict[str, Any]]:
    """Every stored shape."""
    shapes: list[dict[str, Any]] = []
    cursor: dict[str, str] = {}
    while True:
        page = client.get("/shapes", params={"limit": 500, **cursor}).json()
        shapes += page["shapes"]
        if page["next_cursor"] is None:
            return shapes
        cursor = {"cursor": page["next_cursor"]}


def runs(pid: int) -> bool:
    """Whether a process runs; one that has ended may still be listed until somebody asks how it ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in {"Z", "X"}
    except OSError:
        return False


def logged(folder: Path) -> list[str]:
    """The errors in the service's log, which is then emptied."""
    log = folder / "log.txt"
    lines = [line for line in log.read_text().splitlines() if line.startswith("{")]
    log.write_text("")
    return [f"logged: {line}" for line in lines if json.loads(line)["level"] == "error"]
