"""The server of this process: in the foreground, or in a thread for one command."""

import ctypes
import gc
import os
import resource
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.client import Client
from service.jobs.endpoints import ENDING_IN_SCOPE
from service.server.process import LOOPBACK, SHUTDOWN_SECONDS, StartError, bind, wait_until_ready

KEEP_ALIVE_SECONDS = 75
"""How long an idle connection stays open: longer than proxies and clients keep one, so that no request meets
a closing connection."""

MOST_DESCRIPTORS = 65536
LEAST_CONNECTIONS = 8

OWN_DESCRIPTORS = 16
"""Descriptors of the service itself: the database, the workers, the listening socket."""

KEPT_BYTES = 8 * 1024 * 1024
"""Bytes of freed memory that a heap keeps at its end, and the least block that has pages of its own."""
HEAPS = 2
"""Heaps of all threads: Python lets one thread work at a time, and each heap keeps what it once needed."""

# Parameters of `mallopt` in the GNU C library (malloc.h).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8


def run(app: ASGIApp, bound: socket.socket, shutdown_seconds: int) -> None:
    """Serve the app on the socket until a signal; running requests then have `shutdown_seconds` to end.

    The garbage collector leaves out the objects that exist by now, mostly modules. It otherwise takes half of
    the time of reading the signatures of a large archive. Raise StartError if the app's lifespan failed.
    """
    watched = _Watched(app)
    server = watched.server = uvicorn.Server(config(watched, shutdown_seconds))
    gc.freeze()
    return_freed_memory()
    with suppress(KeyboardInterrupt):
        _serve(server, bound)
    if not server.started:
        raise StartError(f"the service could not start: {watched.error}")


@contextmanager
def in_thread(app: ASGIApp, key: str | None = None, collection: str | None = None) -> Iterator[Client]:
    """Run the app with its lifespan and workers on a free loopback port; yield a client once it is ready.

    The client sends the key and names the collection, if they are given. Raise StartError if the app's
    lifespan failed.
    """
    watched = _Watched(app)
    server = watched.server = uvicorn.Server(config(watched))
    with bind(LOOPBACK, 0) as bound:
        port = bound.getsockname()[1]
        thread = threading.Thread(target=_serve, args=(server, bound), name="isoshape service")
        thread.start()
        try:
            while not server.started:
                if not thread.is_alive():
                    raise StartError(f"the service could not start: {watched.error}")
                time.sleep(0.01)
            with Client(f"http://{LOOPBACK}:{port}", key=key, collection=collection) as client:
                wait_until_ready(client, ended=lambda: not thread.is_alive())
                yield client
        finally:
            server.should_exit = True
            thread.join()


def config(app: ASGIApp, shutdown_seconds: int = SHUTDOWN_SECONDS) -> uvicorn.Config:
    """Return the configuration of a server of the app.

    Its limits are uvicorn's own: the number of connections (others are answered 503), the time of an idle
    connection, the 64 KiB of a head. A proxy limits the time of heads and of answers (docs/operating.md); the
    application limits that of bodies.
    """
    connections = most_connections()
    # The service logs its requests and their errors itself.
    return uvicorn.Config(
        app,
        http="h11",
        # Connections are accepted so many at a time, before their number is limited.
        backlog=max(1, connections // 4),
        limit_concurrency=connections,
        # Otherwise any program of this machine could name another address as its own.
        proxy_headers="FORWARDED_ALLOW_IPS" in os.environ,
        lifespan="on",
        log_config=None,
        log_level="critical",
        access_log=False,
        timeout_graceful_shutdown=shutdown_seconds,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
    )


def most_connections() -> int:
    """Return the most connections at a time: half of the descriptors of this process, less its own.

    The other half is for the files and the database connections of requests.
    """
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if not 0 <= descriptors <= MOST_DESCRIPTORS:
        descriptors = MOST_DESCRIPTORS
    return max(LEAST_CONNECTIONS, descriptors // 2 - OWN_DESCRIPTORS)


def return_freed_memory() -> None:
    """Let each of `HEAPS` heaps of this process keep at most `KEPT_BYTES` of freed memory at its end.

    The GNU C library otherwise raises both limits with the sizes of freed blocks, up to 64 and 32 MiB, and
    makes eight heaps for each core: a heap then keeps as much as the large files that it received.
    Child processes have limits of their own. Other C libraries are left as they are.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, KEPT_BYTES)
        mallopt(_M_ARENA_MAX, HEAPS)


def _serve(server: uvicorn.Server, bound: socket.socket) -> None:
    with suppress(SystemExit):  # uvicorn exits if the lifespan fails
        server.run(sockets=[bound])


class _Watched:
    """The app with the error that ended its lifespan, which uvicorn would print as a traceback.

    Requests can see whether the server is stopping: an endless stream would delay the stop.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.error: BaseException | None = None
        self.server: uvicorn.Server | None = None

    def _ending(self) -> bool:
        return self.server is not None and self.server.should_exit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            scope[ENDING_IN_SCOPE] = self._ending
            await self.app(scope, receive, send)
            return

        async def without_traceback(message: Message) -> None:
            await send({"type": message["type"]})

        try:
            await self.app(scope, receive, without_traceback)
        except BaseException as error:
            self.error = error
            raise
