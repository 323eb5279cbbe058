"""A service over HTTP that is killed at an operation on the disk is ready again within 5 s.

These are seconds of a machine on which a service that ended at rest is ready within `AT_REST_SECONDS`:
the starts after a kill are compared with such starts of the same run, by the clock and by the processor.
"""

import asyncio
import os
import shutil
import signal
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import httpx
import psutil

from tests.service.processes import server
from tests.soak.kill.changes import CHANGES, Change, State, finished, make_archive, state
from tests.soak.kill.power import operations
from tests.soak.kill.runs import JOB_SECONDS, READY_SECONDS

AT_REST_SECONDS = 2.5
"""Seconds until a service is ready that ended at rest, on an idle core."""

KILLS = max(2, int(os.environ.get("CYCLES") or 2) // 8)
SEQUENCE = [
    change for change in CHANGES if change.request and change.name not in {"permanent delete", "scan"}
]

T = TypeVar("T")


def asked(http: httpx.Client, ask: Callable[[httpx.AsyncClient], Awaitable[T]]) -> T:
    """Ask the service by an asynchronous client."""

    async def run() -> T:
        async with httpx.AsyncClient(base_url=http.base_url, timeout=60) as client:
            return await ask(client)

    return asyncio.run(run())


def settings(folder: Path) -> dict[str, str]:
    """Settings of a service whose files are below a folder of their own, without its log."""
    return {
        "ISOSHAPE_DATABASE_URL": f"sqlite:///{folder}/place/archive.sqlite3",
        "ISOSHAPE_JOB_FOLDER": f"{folder}/place/jobs",
        "ISOSHAPE_DUPLICATES_IN_BACKGROUND": "false",
    }


def started(folder: Path, done: Callable[[httpx.Client], T]) -> tuple[float, float, T]:
    """Start a service; the seconds and those of a processor until it is ready, and what is done with it."""
    began = time.monotonic()
    with server(folder, **settings(folder)) as (process, client):
        elapsed, (user, system) = time.monotonic() - began, psutil.Process(process.pid).cpu_times()[:2]
        return elapsed, user + system, done(client)


async def made(client: httpx.AsyncClient, change: Change) -> bool:
    """Make a change, with all that it begins; whether it was acknowledged before the service was gone."""
    assert change.request is not None
    try:
        answer = await change.request(client)
    except httpx.TransportError:
        return False
    assert answer.is_success, answer.text
    with suppress(httpx.TransportError):
        await finished(client, JOB_SECONDS)
    return True


def test_a_service_killed_at_an_operation_is_ready_within_5_seconds(
    tmp_path: Path, preloaded: dict[str, str]
) -> None:
    place, archive, log = tmp_path / "place", tmp_path / "archive", tmp_path / "log"
    place.mkdir()
    with server(tmp_path, **settings(tmp_path)) as (_, client):
        asked(client, lambda client: make_archive(client, place))
        states = [asked(client, lambda client: state(client, place))]
    place.rename(archive)

    def run(action: str, point: int) -> list[State]:
        """Make the changes, perhaps under a kill: an item for each acknowledged one, its state if no kill."""
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(archive, place)
        faults = {"FAULTS_FOLDER": str(place), "FAULTS_LOG": str(log)}
        faults |= {"FAULTS_ACTION": action, "FAULTS_POINT": str(point), "LD_PRELOAD": preloaded["LD_PRELOAD"]}
        log.write_bytes(b"")
        states = []
        with server(tmp_path, **settings(tmp_path), **faults) as (process, client):
            for change in SEQUENCE:
                if not asked(client, lambda client, change=change: made(client, change)):
                    break
                states.append({} if point else asked(client, lambda client: state(client, place)))
            assert not point or process.wait(JOB_SECONDS) == -signal.SIGKILL
        return states

    states += run("-", 0)
    last = len(list(operations(log.read_bytes())))
    ratios = []
    for kill in range(KILLS):
        point = last * (2 * kill + 1) // (2 * KILLS)
        acknowledged = len(run("k", point))

        def recovered(client: httpx.Client) -> State:
            asked(client, lambda client: finished(client, JOB_SECONDS))
            return asked(client, lambda client: state(client, place))

        *after_kill, found = started(tmp_path, recovered)
        *at_rest, _ = started(tmp_path, recovered)
        ratios += [after / rest for after, rest in zip(after_kill, at_rest, strict=True)]
        assert found in states[acknowledged : acknowledged + 2], (
            f"operation {point}, {acknowledged} acknowledged"
        )
    print(f"{KILLS} kills among {last} operations: at most {max(ratios):.2f} times as long as after rest")
    assert max(ratios) <= READY_SECONDS / AT_REST_SECONDS
