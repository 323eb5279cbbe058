"""HTTP/1.1 by uvicorn, with a limit on the time of a request's head and on the number of connections."""

import asyncio
import resource
import uuid
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol

from service.errors import PROBLEMS
from service.http.middleware import HEADER
from service.http.problems import problem_response
from service.observability.logging import get_logger, request_id

log = get_logger("server")

LEAST_CONNECTIONS = 8
# Descriptors of the service itself: the database, the workers, the listening socket.
OWN_DESCRIPTORS = 16


def most_connections() -> int:
    """The most connections at a time: half of the descriptors that this process may have, less its own.

    The other half is for the files and the database connections of requests.
    """
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(LEAST_CONNECTIONS, descriptors // 2 - OWN_DESCRIPTORS)


def http_protocol(head_seconds: float, connections: int | None = None) -> type[asyncio.Protocol]:
    """The protocol of a server.

    Parameters
    ----------
    head_seconds : float
        The longest time from the opening of a connection, or from the first byte of a later request, to the
        end of the request's head. The connection is then closed, after 408 if a part of a head has arrived.
    connections : int, optional
        The most connections at a time; `most_connections` unless given. Another one closes the connection
        that has been without a request for longest, or is closed itself.
    """
    most = most_connections() if connections is None else connections

    class Protocol(_LimitedProtocol):
        HEAD_SECONDS = head_seconds
        MOST = most

    return Protocol


class _LimitedProtocol(H11Protocol):
    """uvicorn's protocol of one connection with the limits."""

    HEAD_SECONDS: float
    MOST: int

    def __init__(self, *arguments: Any, **named: Any) -> None:  # noqa: ANN401
        super().__init__(*arguments, **named)
        self._head_timer: asyncio.TimerHandle | None = None
        self._head_begun = False
        self._idle_since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a head, and make room if there are too many connections."""
        super().connection_made(transport)
        self._idle_since = self.loop.time()
        self._wait_for_head()
        connected = [
            each
            for each in self.connections
            if isinstance(each, _LimitedProtocol) and not each.transport.is_closing()
        ]
        if len(connected) > self.MOST:
            # Without another idle one, this connection is the longest idle.
            longest = min((each for each in connected if each.is_idle), key=lambda each: each._idle_since)
            log.warning("a connection is closed: %d are the most", self.MOST)
            longest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Read the bytes that have arrived; the time of a head begins with its first byte."""
        super().data_received(data)
        if not self.is_idle:
            self._stop_waiting()
        elif not self.transport.is_closing():
            self._head_begun = True
            self._wait_for_head()

    def on_response_complete(self) -> None:
        """Be idle; uvicorn closes the connection if no further request begins."""
        self._head_begun = False
        self._idle_since = self.loop.time()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are no HTTP with a problem document."""
        self._refuse("bad-request", msg)

    @property
    def is_idle(self) -> bool:
        """Whether the connection has no request that is being answered."""
        return self.cycle is None or self.cycle.response_complete

    def _wait_for_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(self.HEAD_SECONDS, self._head_is_late)

    def _stop_waiting(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _head_is_late(self) -> None:
        self._head_timer = None
        if self.transport.is_closing() or not self.is_idle:
            return
        if self._head_begun and self.conn.our_state is h11.IDLE:
            self._refuse("request-timeout", f"the head of the request took over {self.HEAD_SECONDS:g} s")
        else:
            self.transport.close()

    def _refuse(self, kind: str, detail: str) -> None:
        """Answer a request whose head is not read with a problem document, and close the connection."""
        identifier = uuid.uuid4().hex
        token = request_id.set(identifier)
        try:
            response = problem_response(kind, detail)
            log.info("request refused", extra={"fields": {"problem": kind, "status": PROBLEMS[kind].status}})
        finally:
            request_id.reset(token)
        headers = [*response.raw_headers, (HEADER.encode(), identifier.encode()), (b"connection", b"close")]
        status = response.status_code
        for event in (
            h11.Response(status_code=status, headers=headers, reason=STATUS_PHRASES[status]),
            h11.Data(data=bytes(response.body)),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()
