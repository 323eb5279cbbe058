"""The executor of worker processes, without the service."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, wait
from functools import partial
from multiprocessing import forkserver
from pathlib import Path

import psutil
import pytest

from core.errors import EmptyFileError
from core.parameters import DEFAULT
from service.compute import processes
from service.compute.cluster import ClusterPool
from service.compute.pool import LocalPool
from service.compute.worker_loop import NICENESS
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerLostError
from service.settings import PREFIX
from tests.service.dask_cluster import cluster
from tests.service.support import children, wait_until
from tests.service.tasks import (
    add,
    die,
    environment,
    fail_to_warm,
    hang_second,
    meet,
    nap,
    nap_instead,
    pid_at_meeting,
    raise_oddly,
    refuse,
    return_a_lock,
    warm,
)

Pool = LocalPool | ClusterPool


@pytest.fixture(scope="module", autouse=True)
def _fork_servers_are_light() -> Iterator[None]:
    """These tests have fork servers killed, and run no kernel."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "LOADED", ["tests.service.tasks"])
        yield
    processes.fork_server()
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)


@pytest.fixture(scope="module")
def pool() -> Iterator[LocalPool]:
    with LocalPool(2, seconds=60, warm=warm) as pool:
        yield pool


@pytest.fixture(scope="module", params=["local", "cluster"])
def workers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    """Two workers, each a process here; or both processes of the worker of a Dask cluster."""
    if request.param == "local":
        yield request.getfixturevalue("pool")
        return
    with (
        cluster(tmp_path_factory.mktemp("cluster"), workers=1, threads=2) as made,
        ClusterPool(made.address, parameters=DEFAULT, seconds=60) as pool,
    ):
        wait_until(pool.pids, seconds=120)
        yield pool


def test_queries_in_the_service_go_before_the_work_of_workers(workers: Pool) -> None:
    worker = psutil.Process(workers.submit(os.getpid).result())
    assert worker.nice() == min(worker.parent().nice() + NICENESS, 19)


def test_results_and_errors_come_back(workers: Pool) -> None:
    futures = [workers.submit(add, i, i) for i in range(20)]
    assert [future.result() for future in futures] == [2 * i for i in range(20)]
    with pytest.raises(EmptyFileError, match="nothing in it") as caught:
        workers.submit(refuse, "nothing in it").result()
    assert "in refuse" in "".join(caught.value.__notes__)


def test_tasks_take_positional_arguments_only(workers: Pool) -> None:
    with pytest.raises(TypeError):
        workers.submit(add, a=1, b=2)


def test_workers_have_one_thread_and_ignore_interrupts(workers: Pool) -> None:
    seen = workers.submit(environment).result()
    assert set(seen["threads"].values()) == {"1"}
    os.kill(seen["pid"], signal.SIGINT)
    assert workers.submit(add, 1, 1).result() == 2


def test_fork_server_and_workers_inherit_no_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings may be secrets, and what a process was started with stays readable in it."""
    settings = {"ISOSHAPE_WEBHOOK_SECRET": "whsec_a", "isoshape_database_url": "postgresql://a:b@c/d"}
    for name, value in (settings | {"OTHER": "kept"}).items():
        monkeypatch.setenv(name, value)
    processes.fork_server()
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
    # The process may live on for a moment; the start of the next fork server reaps it.
    os.waitid(os.P_PID, forkserver._forkserver._forkserver_pid, os.WEXITED | os.WNOWAIT)
    with LocalPool(1, seconds=60, warm=warm) as pool:
        assert pool.submit(add, 1, 1).result() == 2
        for pid in (fork_server_of(pool), *pool.pids()):
            inherited = psutil.Process(pid).environ()
            assert inherited["OTHER"] == "kept"
            assert not [name for name in inherited if name.upper().startswith(PREFIX)]
    assert dict(os.environ).items() >= settings.items()


def test_both_workers_work_at_a_time(tmp_path: Path) -> None:
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    with LocalPool(2, seconds=60, warm=warm) as pool:
        # Each waits for the other, up to the limit.
        for future in [pool.submit(meet, one, two), pool.submit(meet, two, one)]:
            assert future.result() is None


def test_a_further_process_starts_when_all_others_have_a_task(tmp_path: Path) -> None:
    def rendezvous(number: int) -> tuple[str, str]:
        return str(tmp_path / f"{number} begun"), str(tmp_path / f"{number} end")

    with LocalPool(1, more=1, seconds=60, warm=warm) as pool:
        for number in range(3):
            assert pool.submit(add, number, 1).result() == number + 1
        wait_until(lambda: pool.counts().idle == 1, seconds=60)
        assert len(pool.pids()) == 1
        tasks = [pool.submit(meet, *rendezvous(number)) for number in range(3)]
        for number in range(2):
            wait_until(Path(rendezvous(number)[0]).exists, seconds=60)
        assert len(pool.pids()) == 2
        assert pool.counts().waiting == 1
        assert not Path(rendezvous(2)[0]).exists()
        for number in range(3):
            Path(rendezvous(number)[1]).touch()
        assert [task.result() for task in tasks] == [None] * 3


def test_a_further_process_that_cannot_start_costs_no_task(tmp_path: Path) -> None:
    started, begun, end = (tmp_path / name for name in ("started", "begun", "end"))
    started.mkdir()
    with LocalPool(1, more=1, seconds=60, warm=partial(hang_second, str(started))) as pool:
        wait_until(pool.pids, seconds=60)
        pool.start_seconds = 1.0
        tasks = [
            pool.submit(meet, str(begun), str(end)),
            *(pool.submit(add, number, 1) for number in range(3)),
        ]
        assert len(pool._slots) == 2
        wait_until(lambda: len(pool._slots) == 1, seconds=60)
        assert not any(task.done() for task in tasks)
        end.touch()
        assert [task.result() for task in tasks] == [None, 1, 2, 3]


def test_a_task_over_the_limit_is_stopped_and_the_rest_go_on(
    workers: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(workers, "seconds" if isinstance(workers, LocalPool) else "_seconds", 5)
        slow: Future[None] = workers.submit(nap, 600)
        others = [workers.submit(add, i, 1) for i in range(10)]
        with pytest.raises(TaskTimeLimitError, match="5 s"):
            slow.result()
    assert [future.result() for future in others] == list(range(1, 11))


def test_a_worker_that_dies_costs_the_task_it_had(workers: Pool) -> None:
    dead = workers.submit(die)
    others = [workers.submit(add, i, 1) for i in range(10)]
    with pytest.raises(WorkerLostError):
        dead.result()
    assert [future.result() for future in others] == list(range(1, 11))
    wait_until(lambda: workers.pids() and not workers.counts().starting, seconds=60)


def fork_server_of(pool: LocalPool) -> int:
    """Return the process id of the fork server."""
    status = Path(f"/proc/{pool.pids()[0]}/status").read_text()
    return int(status.partition("PPid:")[2].split()[0])


def test_workers_that_die_idle_cost_nothing(pool: LocalPool) -> None:
    wait_until(lambda: len(pool.pids()) == 2, seconds=60)
    old = pool.pids()
    for pid in old:
        os.kill(pid, signal.SIGKILL)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in old), seconds=10)
    assert [future.result() for future in [pool.submit(add, i, 1) for i in range(4)]] == [1, 2, 3, 4]
    assert not set(pool.pids()) & set(old)


def test_a_fork_server_that_is_killed_costs_nothing(pool: LocalPool) -> None:
    wait_until(lambda: len(pool.pids()) == 2, seconds=60)
    old = pool.pids()
    fork_server = fork_server_of(pool)
    assert fork_server != os.getpid()
    os.kill(fork_server, signal.SIGKILL)
    assert [future.result() for future in [pool.submit(add, i, 1) for i in range(10)]] == list(range(1, 11))
    # Nor do its workers need it to be replaced.
    dead = pool.submit(die)
    with pytest.raises(WorkerLostError):
        dead.result()
    assert [future.result() for future in [pool.submit(add, i, 1) for i in range(10)]] == list(range(1, 11))
    wait_until(lambda: len(pool.pids()) == 2 and set(pool.pids()) != set(old), seconds=60)


def test_a_result_that_does_not_pickle_is_an_error_of_its_task(workers: Pool) -> None:
    with pytest.raises((TypeError, AttributeError)):
        workers.submit(add, threading.Lock(), 1).result()
    with pytest.raises(TypeError, match="pickle"):
        workers.submit(return_a_lock).result()
    with pytest.raises(RuntimeError, match=r"OddError.*1 and 2"):
        workers.submit(raise_oddly).result()
    assert workers.submit(add, 1, 1).result() == 2


def test_a_cancelled_task_is_not_begun(workers: Pool) -> None:
    blocking = [workers.submit(nap, 0.5) for _ in range(2)]
    waiting = workers.submit(die)
    assert waiting.cancel()
    wait(blocking)
    assert workers.submit(add, 1, 1).result() == 2


def test_a_cancelled_task_lets_go_of_its_arguments(pool: LocalPool) -> None:
    blocking = [pool.submit(nap, 0.5) for _ in range(2)]
    waiting = pool.submit(add, b"x" * 1_000_000, b"")
    assert waiting.cancel()
    assert waiting.cancel()
    assert waiting.arguments == ()  # type: ignore[attr-defined]
    wait(blocking)


def test_a_cancelled_task_that_has_begun_holds_up_nothing(workers: Pool) -> None:
    napping = [workers.submit(nap, 600) for _ in range(2)]
    wait_until(lambda: workers.counts().busy == 2, seconds=30)
    for each in napping:
        each.cancel()
    assert workers.submit(add, 1, 1).result(timeout=60) == 2


@pytest.mark.parametrize(("seconds", "stopped"), [(600, True), (0.2, False)])
def test_a_task_that_is_cancelled_while_it_runs_is_stopped_unless_it_ends_shortly(
    seconds: float, stopped: bool
) -> None:
    with LocalPool(1, seconds=600, warm=warm) as pool:
        task, next_one = pool.submit(nap, seconds), pool.submit(add, 1, 1)
        wait_until(task.running, seconds=60)
        before = pool.pids()
        assert not task.cancel()
        assert next_one.result(timeout=60) == 2
        assert isinstance(task.exception(), TaskGivenUpError) == stopped
        assert (pool.pids() != before) == stopped


def test_ready_while_idle_and_while_busy(pool: LocalPool) -> None:
    assert pool.ready()
    busy = [pool.submit(nap, 1) for _ in range(2)]
    wait_until(lambda: all(future.running() for future in busy), seconds=5)
    assert pool.ready()
    wait(busy)


def test_ready_while_a_worker_is_renewed() -> None:
    with LocalPool(1, seconds=10, warm=partial(nap, 0.5), tasks_each=1) as pool:
        assert pool.submit(add, 1, 1).result(timeout=60) == 2
        wait_until(lambda: not pool.pids(), seconds=5)
        assert pool.ready()


def test_a_process_that_is_started_ahead_has_no_more_time_than_another(tmp_path: Path) -> None:
    warm = partial(hang_second, str(tmp_path))
    with LocalPool(1, seconds=10, warm=warm, start_seconds=6, tasks_each=2) as pool:
        first = pool.submit(os.getpid).result(timeout=60)
        time.sleep(6)
        assert pool.submit(add, 1, 1).result(timeout=60) == 2
        wait_until(lambda: pool.pids() not in ([], [first]), seconds=5)


def pids_of_all(pool: LocalPool, slots: int, folder: Path) -> set[int]:
    """Give each slot one task and return the process ids."""
    folder.mkdir()
    places = [str(folder / str(slot)) for slot in range(slots)]
    tasks = [pool.submit(pid_at_meeting, place, *places) for place in places]
    return {task.result(timeout=60) for task in tasks}


def test_slots_that_work_alike_are_renewed_one_after_another(tmp_path: Path) -> None:
    with LocalPool(2, seconds=60, warm=warm, tasks_each=4) as pool:
        rounds = [pids_of_all(pool, 2, tmp_path / str(number)) for number in range(6)]
    new = [len(pids.difference(*rounds[:number])) for number, pids in enumerate(rounds)]
    assert new == [2, 0, 1, 0, 1, 0]


def test_one_slot_at_a_time_has_a_process_that_is_started_ahead(tmp_path: Path) -> None:
    others = children()
    # Of three slots and two tasks each, two slots have the same phase.
    with LocalPool(3, seconds=60, warm=warm, tasks_each=2) as pool:
        first = pids_of_all(pool, 3, tmp_path / "first")
        wait_until(lambda: len(pool.pids()) == 3 and set(pool.pids()) != first, seconds=60)
        assert len(set(pool.pids()) & first) == 2
        wait_until(lambda: len(children() - others) > 3, seconds=60)
        # The turn is passed on: all slots go on, with a new process after two tasks.
        later, most = [], 0
        for number in range(4):
            most = max(most, len(children() - others))
            later.append(pids_of_all(pool, 3, tmp_path / str(number)))
        assert most == 4
        assert len(set().union(*later[2:]) & first) == 0
    assert children() == others


def test_a_pool_whose_workers_do_not_start_says_so_and_does_not_hang() -> None:
    pool = LocalPool(1, seconds=1, warm=fail_to_warm)
    with pytest.raises(WorkerLostError):
        pool.submit(add, 1, 1).result(timeout=60)
    assert not pool.ready()
    pool.shutdown()


def test_shutdown_finishes_what_was_begun_and_cancels_what_was_not() -> None:
    pool = LocalPool(1, seconds=5, warm=warm)
    running = pool.submit(nap, 0.5)
    waiting = pool.submit(add, 1, 1)
    wait_until(running.running, seconds=60)
    pids = pool.pids()
    pool.shutdown(cancel_futures=True)
    assert running.result() is None
    assert waiting.cancelled()
    assert not any(os.path.exists(f"/proc/{pid}") for pid in pids)
    with pytest.raises(RuntimeError):
        pool.submit(add, 1, 1)


def test_shutdown_does_not_wait_for_a_worker_that_is_warming_up() -> None:
    others = children()
    pool = LocalPool(1, seconds=5, warm=nap_instead)
    waiting = pool.submit(add, 1, 1)
    wait_until(lambda: children() - others, seconds=10)
    start = time.monotonic()
    pool.shutdown(cancel_futures=True)
    assert time.monotonic() - start < 5
    assert waiting.cancelled()
    assert children() == others


def test_leaving_the_block_finishes_what_was_given() -> None:
    with LocalPool(1, seconds=5, warm=warm) as pool:
        futures = [pool.submit(add, i, 1) for i in range(5)]
    assert [future.result() for future in futures] == [1, 2, 3, 4, 5]


def test_a_pool_that_is_killed_waits_for_nothing() -> None:
    pool = LocalPool(1, seconds=600, warm=warm)
    running, waiting = pool.submit(nap, 600), pool.submit(add, 1, 1)
    wait_until(running.running, seconds=60)
    pids = pool.pids()
    start = time.monotonic()
    pool.kill()
    assert time.monotonic() - start < 5
    assert isinstance(running.exception(), WorkerLostError)
    assert waiting.cancelled()
    assert not any(os.path.exists(f"/proc/{pid}") for pid in pids)


@pytest.mark.parametrize("ends", [False, True])
def test_a_fork_server_that_stands_still_is_replaced(monkeypatch: pytest.MonkeyPatch, ends: bool) -> None:
    """A new worker waits for its process id, and a dead one for its exit code."""
    # A new fork server on a busy machine may wait for a processor.
    monkeypatch.setattr(processes, "STOPPED_SECONDS", 3.0)
    with LocalPool(1, seconds=60, warm=warm) as pool:
        wait_until(pool.pids, seconds=60)
        (worker,) = pool.pids()
        fork_server = fork_server_of(pool)
        os.kill(fork_server, signal.SIGSTOP)
        if not ends:
            with pytest.raises(WorkerLostError):
                pool.submit(die).result(timeout=60)
            assert pool.submit(os.getpid).result(timeout=60) != worker
    assert not processes.is_stopped(fork_server)


def test_a_process_that_takes_no_call_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call larger than the buffer of the pipe waits for a process that stands still."""
    monkeypatch.setattr(processes, "SEND_SECONDS", 0.5)
    with LocalPool(1, seconds=60, warm=warm) as pool:
        wait_until(pool.pids, seconds=60)
        (stopped,) = pool.pids()
        os.kill(stopped, signal.SIGSTOP)
        assert pool.submit(len, b"x" * 1_000_000).result(timeout=60) == 1_000_000
        assert pool.submit(os.getpid).result() != stopped


def test_a_worker_that_stands_still_costs_its_call_a_repetition(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not its call that takes too long, so that the call may be repeated."""
    monkeypatch.setattr(processes, "STOPPED_SECONDS", 0.5)
    with LocalPool(1, seconds=60, warm=warm) as pool:
        wait_until(pool.pids, seconds=60)
        (stopped,) = pool.pids()
        call = pool.submit(nap, 30)
        wait_until(call.running, seconds=10)
        os.kill(stopped, signal.SIGSTOP)
        start = time.monotonic()
        with pytest.raises(WorkerLostError, match="stopped"):
            call.result()
        assert time.monotonic() - start < 10
        assert pool.submit(os.getpid).result() != stopped


PROGRAM = """
print("imported", flush=True)

if __name__ == "__main__":
    from service.compute.processes import WorkerProcess

    process = WorkerProcess()
    process.send(len, ("three",))
    print(process.receive(100.0))
    process.end()
"""


def test_a_process_does_not_import_the_program_that_runs_the_service(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    printed = subprocess.check_output([sys.executable, program], text=True, cwd=Path.cwd())
    assert printed.split() == ["imported", "5"]
