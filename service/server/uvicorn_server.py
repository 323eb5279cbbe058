"""The server of this process: in the foreground, or in a thread for one command."""

import gc
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.client import Client
from service.errors import ExpectedError
from service.jobs.events import ENDING_IN_SCOPE
from service.server.address import LOOPBACK, bind
from service.server.allocator import return_freed_memory
from service.server.http_protocol import http_protocol, most_connections

# On a busy machine the first start compiles for many minutes.
READY_SECONDS = 3600.0
# For a service that one command uses; no request is left when it stops.
SHUTDOWN_SECONDS = 10
HEAD_SECONDS = 20.0
# Longer than proxies and clients keep a connection, so that no request meets a closing one.
KEEP_ALIVE_SECONDS = 75


class StartError(ExpectedError):
    """The service did not start; the message gives the reason."""


def run(app: ASGIApp, bound: socket.socket, *, shutdown_seconds: int, head_seconds: float) -> None:
    """Serve the app on the socket until a signal; running requests then have `shutdown_seconds` to end.

    A client has `head_seconds` for the head of a request.

    The garbage collector leaves out the objects that exist by now, mostly modules. It otherwise takes half of
    the time of reading the signatures of a large archive.

    Raises
    ------
    StartError
        The app's lifespan failed.
    """
    watched = _Watched(app)
    server = watched.server = uvicorn.Server(_config(watched, shutdown_seconds, head_seconds))
    gc.freeze()
    return_freed_memory()
    with suppress(KeyboardInterrupt):
        _serve(server, bound)
    if not server.started:
        raise StartError(f"the service could not start: {watched.error}")


@contextmanager
def in_thread(app: ASGIApp, key: str | None = None, collection: str | None = None) -> Iterator[Client]:
    """Run the app with its lifespan and workers on a free loopback port; yield a client once it is ready.

    The client sends the key and names the collection, if they are given.

    Raises
    ------
    StartError
        The app's lifespan failed.
    """
    watched = _Watched(app)
    server = watched.server = uvicorn.Server(_config(watched, SHUTDOWN_SECONDS, HEAD_SECONDS))
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


def wait_until_ready(client: Client, ended: Callable[[], bool]) -> None:
    """Return when the service is ready. On the first start its workers compile.

    Raises
    ------
    StartError
        The service ended, or is not ready after an hour.
    """
    deadline = time.monotonic() + READY_SECONDS
    while not client.ready():
        if ended():
            raise StartError("the service ended before it was ready")
        if time.monotonic() > deadline:
            raise StartError(f"the service was not ready after {READY_SECONDS:.0f} s")
        time.sleep(0.1)


def _serve(server: uvicorn.Server, bound: socket.socket) -> None:
    with suppress(SystemExit):  # uvicorn exits if the lifespan fails
        server.run(sockets=[bound])


def _config(app: ASGIApp, shutdown_seconds: int, head_seconds: float) -> uvicorn.Config:
    # The service logs its requests and their errors itself.
    return uvicorn.Config(
        app,
        http=http_protocol(head_seconds),
        # Connections are accepted so many at a time, before their number is limited.
        backlog=max(1, most_connections() // 4),
        # Otherwise any program of this machine could name another address as its own.
        proxy_headers="FORWARDED_ALLOW_IPS" in os.environ,
        lifespan="on",
        log_config=None,
        log_level="critical",
        access_log=False,
        timeout_graceful_shutdown=shutdown_seconds,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
    )


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
