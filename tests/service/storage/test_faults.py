"""Workers that fail beneath the service: it says so, and goes on by itself once that is over."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from core.io import write_mesh
from service.compute import request_queue as work_module
from service.compute import tasks
from service.http.problem_document import TYPE_PREFIX
from service.search import scoring
from tests.core.shapes import box
from tests.service.calls import Calls, assert_recovered, reads, the_kept
from tests.service.processes import runs
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    query,
    small_file,
    upload,
    wait_until,
)
from tests.service.tasks import break_down_over_cube, nap_instead, napping, run_out_of_memory
from tests.soak.hostile.packages import brackets

frail = module_service(stored={"kept": small_file(0)})
"""A service with one worker."""


@pytest.fixture
def kept(frail: Running) -> str:
    """The shape that is there all the time."""
    return the_kept(frail)


def calls(frail: Running, kept: str) -> Calls:
    """The requests of a client; the upload and the query need an embedding."""
    return reads(frail, kept) | {
        "upload": lambda: upload(frail.client, small_file(2), "lost.off"),
        "query": lambda: query(frail.client, small_file(2)),
    }


@pytest.mark.parametrize(
    ("task", "name"), [("embed_mesh", "upload"), ("embed_mesh", "query"), ("match_embeddings", "compare")]
)
def test_a_worker_that_is_killed(
    frail: Running, kept: str, monkeypatch: pytest.MonkeyPatch, task: str, name: str
) -> None:
    pool = frail.container.pool
    wait_until(pool.pids, seconds=60)

    def kill() -> None:
        wait_until(lambda: napping(pool), seconds=60)
        # Another process of the pool may be idle.
        process = napping(pool)
        assert process
        os.kill(process, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    with monkeypatch.context() as patch:
        patch.setattr(work_module if task == "embed_mesh" else tasks, task, nap_instead)
        killer.start()
        assert_problem(calls(frail, kept)[name](), 503, "worker-lost")
    killer.join()
    assert_recovered(frail, kept)


def test_a_file_of_a_batch_over_which_its_worker_breaks_down(
    frail: Running, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [("file", ("cube.off", write_mesh(box(1, 1, 1), "off"))), ("file", ("small.off", small_file(2)))]
    with monkeypatch.context() as patch:
        patch.setattr(work_module, "embed_mesh", break_down_over_cube)
        answer = frail.client.post("/query/batch", files=files)
    broken, answered = answer.raise_for_status().json()["answers"]
    assert broken["type"] == TYPE_PREFIX + "worker-lost"
    assert [result["shape"]["id"] for result in answered["results"]] == [kept]
    assert_recovered(frail, kept)


def test_a_file_over_which_its_reader_breaks_down(frail: Running, kept: str) -> None:
    """Nobody is told to send it again."""
    problem = assert_problem(upload(frail.client, brackets(), "brackets.step"), 422, "malformed-mesh")
    assert "broke down" in problem["detail"]
    assert_recovered(frail, kept)


@pytest.mark.parametrize(
    ("task", "name", "status", "kind"),
    [("embed_mesh", "upload", 422, "mesh-too-complex"), ("match_embeddings", "compare", 503, "worker-lost")],
)
def test_a_worker_without_memory(
    frail: Running, kept: str, monkeypatch: pytest.MonkeyPatch, task: str, name: str, status: int, kind: str
) -> None:
    wait_until(frail.container.pool.pids, seconds=60)
    before = frail.container.pool.pids()
    with monkeypatch.context() as patch:
        patch.setattr(work_module if task == "embed_mesh" else tasks, task, run_out_of_memory)
        assert "memory" in assert_problem(calls(frail, kept)[name](), status, kind)["detail"]
    assert frail.container.pool.pids() == before
    assert_recovered(frail, kept)


def test_comparing_without_memory(frail: Running, kept: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(scoring, "score_match_records", run_out_of_memory)
        problem = assert_problem(reads(frail, kept)["query"](), 503, "worker-lost")
        assert "memory" in problem["detail"]
    assert_recovered(frail, kept)


def test_workers_of_a_killed_process_end_in_the_middle_of_their_tasks() -> None:
    program = "from tests.service.tasks import serve_until_killed; serve_until_killed()"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pids = [int(pid) for pid in process.stdout.readline().split()]
        assert len(pids) == 2
        assert all(runs(pid) for pid in pids)
        process.kill()
        wait_until(lambda: not any(runs(pid) for pid in pids), seconds=30)
