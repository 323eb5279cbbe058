"""A Dask scheduler and its workers: processes on loopback, which may be killed and started again."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil


class Cluster:
    """A scheduler at one address, and workers of so many threads."""

    def __init__(self, folder: Path, threads: int = 1) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self._port}"
        self._folder = folder
        self._threads = threads
        self._scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start(self, workers: int = 2) -> None:
        """Start a scheduler where none is, and so many workers."""
        if self._scheduler is None:
            options = ["--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard", "--no-show"]
            self._scheduler = self._run("dask_scheduler", *options)
        for _ in range(workers):
            options = [
                "--no-nanny",
                "--nthreads",
                str(self._threads),
                "--no-dashboard",
                "--memory-limit",
                "0",
            ]
            options += ["--host", "127.0.0.1", "--local-directory", str(self._folder), "--memory-limit", "0"]
            self.workers.append(self._run("dask_worker", self.address, *options))

    def kill_worker(self, pid: int | None = None) -> None:
        """Kill a worker, the first unless it is named, and wait until it is gone."""
        worker = next(each for each in self.workers if pid in {None, each.pid})
        self.workers.remove(worker)
        _kill(worker)

    def kill_scheduler(self) -> None:
        """Kill the scheduler; the workers, which are nothing without one, end by themselves or are ended."""
        assert self._scheduler is not None
        _kill(self._scheduler)
        self._scheduler = None
        while self.workers:
            self.kill_worker()

    def stop(self) -> None:
        if self._scheduler is not None:
            self.kill_scheduler()

    def _run(self, program: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *options]
        environment = os.environ | {
            "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
            "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
        }
        with (self._folder / "dask.txt").open("ab") as log:
            return subprocess.Popen(command, env=environment, stdout=log, stderr=log)


@contextmanager
def cluster(folder: Path, workers: int = 2, threads: int = 1) -> Iterator[Cluster]:
    """A scheduler with workers, which are gone at the end."""
    made = Cluster(folder, threads)
    made.start(workers)
    try:
        yield made
    finally:
        made.stop()


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process; its children end with it."""
    children = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    process.send_signal(signal.SIGKILL)
    process.wait()
    psutil.wait_procs(children, timeout=30)
