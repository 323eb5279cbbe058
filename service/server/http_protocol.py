"""HTTP/1.1 by uvicorn, with limits on slow requests, on answers that are not read, and on connections."""

import asyncio
import resource
import socket
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
MOST_DESCRIPTORS = 65536
# A client must read so much of its answer in each period, or the rest.
LEAST_BYTES = 64 * 1024
# Descriptors of the service itself: the database, the workers, the listening socket.
OWN_DESCRIPTORS = 16


def most_connections() -> int:
    """The most connections at a time: half of the descriptors that this process may have, less its own.

    The other half is for the files and the database connections of requests.
    """
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if not 0 <= descriptors <= MOST_DESCRIPTORS:
        descriptors = MOST_DESCRIPTORS
    return max(LEAST_CONNECTIONS, descriptors // 2 - OWN_DESCRIPTORS)


def http_protocol(seconds: float, connections: int | None = None) -> type[asyncio.Protocol]:
    """The protocol of a server.

    Parameters
    ----------
    seconds : float
        The longest time from the opening of a connection, or from the first byte of a later request, to the
        end of the request's head. The connection is then closed, after 408 if a part of a head has arrived.
        Also the period in which a client must read `LEAST_BYTES` of its answer.
    connections : int, optional
        The most connections at a time; `most_connections` unless given. Another one closes the connection
        that has been without a request for longest, or is closed itself.
    """
    most = most_connections() if connections is None else connections

    class Protocol(_LimitedProtocol):
        SECONDS = seconds
        MOST = most

    return Protocol


class _LimitedProtocol(H11Protocol):
    """uvicorn's protocol of one connection with the limits."""

    SECONDS: float
    MOST: int

    def __init__(self, *arguments: Any, **named: Any) -> None:  # noqa: ANN401
        super().__init__(*arguments, **named)
        self._head_timer: asyncio.TimerHandle | None = None
        self._head_begun = False
        self._idle_since = 0.0
        self._write_timer: asyncio.TimerHandle | None = None
        self._unsent = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a head, and make room if there are too many connections."""
        super().connection_made(transport)
        # Writing is paused while bytes of an answer wait for the client, so that their time can be limited.
        transport.set_write_buffer_limits(0)
        if hasattr(socket, "TCP_NOTSENT_LOWAT"):
            # The kernel would otherwise take megabytes at a time, and no progress would be seen meanwhile.
            transport.get_extra_info("socket").setsockopt(
                socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, LEAST_BYTES
            )
        self._idle_since = self.loop.time()
        self._wait_for_head()
        if len(self.connections) > self.MOST:
            # Without another idle one, this connection is the longest idle.
            idle = (each for each in self.connections if isinstance(each, _LimitedProtocol) and each.is_idle)
            longest = min(idle, key=lambda each: each._idle_since)
            log.warning("a connection is closed: %d are the most", self.MOST)
            longest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Read the bytes that have arrived; the time of a head begins with its first byte."""
        super().data_received(data)
        if not self._is_answered:
            self._stop_waiting()
        elif not self.transport.is_closing():
            # Other bytes belong to the body of a request that was answered before its end.
            if not self._head_begun and self.conn.their_state is h11.IDLE and self.conn.trailing_data[0]:
                self._head_begun = True
                if self.cycle is not None:
                    self._stop_waiting()
            self._wait_for_head()

    def on_response_complete(self) -> None:
        """Be idle; uvicorn closes the connection if no further request begins."""
        self._head_begun = False
        self._idle_since = self.loop.time()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        self._stop_writing()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are no HTTP with a problem document, unless an answer has begun already."""
        if self.conn.our_state in {h11.IDLE, h11.SEND_RESPONSE}:
            self._refuse("bad-request", msg)
        else:
            self.transport.abort()

    def pause_writing(self) -> None:
        """Begin to wait for the client, which has not read all of its answer."""
        super().pause_writing()
        self._unsent = self.transport.get_write_buffer_size()
        self._write_timer = self.loop.call_later(self.SECONDS, self._check_reading)

    def resume_writing(self) -> None:
        """Wait no more: the kernel has all bytes of the answer."""
        super().resume_writing()
        self._stop_writing()

    @property
    def is_idle(self) -> bool:
        """Whether the connection is open and has nothing to answer or to send."""
        return self._is_answered and not self.flow.write_paused and not self.transport.is_closing()

    @property
    def _is_answered(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    def _wait_for_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(self.SECONDS, self._head_is_late)

    def _stop_waiting(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _stop_writing(self) -> None:
        if self._write_timer is not None:
            self._write_timer.cancel()
            self._write_timer = None

    def _check_reading(self) -> None:
        """Close the connection of a client that reads its answer too slowly."""
        unsent = self.transport.get_write_buffer_size()
        if self._unsent - unsent < LEAST_BYTES:
            log.info("a connection is closed: its client does not read the answer")
            self.transport.abort()
            return
        self._unsent = unsent
        self._write_timer = self.loop.call_later(self.SECONDS, self._check_reading)

    def _head_is_late(self) -> None:
        self._head_timer = None
        if self.transport.is_closing() or not self._is_answered:
            return
        if self._head_begun and self.conn.our_state is h11.IDLE:
            self._refuse("request-timeout", f"the head of the request took over {self.SECONDS:g} s")
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
        if self.cycle is not None:
            # A request whose body cannot be read is over.
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        self.transport.close()
