"""The start of `isoshape serve`, as its terminal shows it: the compilation of the kernels, and readiness."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from socket import AF_INET6, socket

import httpx

from core.parameters import Parameters
from service.client import Client, ClientError
from service.compute.compilation import is_compiled
from service.console import say
from service.server.process import LOOPBACK

ASK_SECONDS = 0.1
PROBE = httpx.Timeout(5.0)
END_SECONDS = 1.0


@contextmanager
def compiling(parameters: Parameters, scheduler: str) -> Iterator[None]:
    """Show the compilation of missing kernels, in a process of its own, for which the workers wait.

    The memory of a compiler would stay with the service. Workers of a cluster compile where they are.
    """
    if scheduler or is_compiled(parameters):
        yield
        return
    # -P: files in the working folder are not part of the program.
    process = subprocess.Popen([sys.executable, "-P", "-m", "service.cli", "compile"])
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextmanager
def told_when_ready(bound: socket, url: str) -> Iterator[None]:
    """Say that the service listens once it is ready, if it becomes so during the block."""
    ended = threading.Event()

    def watch() -> None:
        with Client(_reachable(bound), timeout=PROBE) as client:
            while not ended.wait(ASK_SECONDS):
                try:
                    ready = client.ready()
                except ClientError:
                    continue
                if ready:
                    say(f"Isoshape listens on {url}")
                    return

    thread = threading.Thread(target=watch, daemon=True, name="isoshape-ready")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(END_SECONDS)


def _reachable(bound: socket) -> str:
    """The address at which this process reaches a socket that may listen on all addresses."""
    host, port = bound.getsockname()[:2]
    if bound.family == AF_INET6:
        return f"http://[{'::1' if host == '::' else host}]:{port}"
    return f"http://{LOOPBACK if host == '0.0.0.0' else host}:{port}"
