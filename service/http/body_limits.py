"""Limits on the bodies of requests: their size, the time without progress, and the room of each client."""

import asyncio
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import FileTooLargeError, ServiceError, StalledBodyError, StorageFullError
from service.http.middleware import client_of
from service.http.problems import RefusedBodyError, problem_of
from service.turns import Shares

FORM_OVERHEAD = 1024 * 1024
# The longest text of a shape, and the longest query, each with its characters written as \uXXXX. The time to
# validate a larger object would delay other requests.
SMALL_BODY_BYTES = 64 * 1024
# Starlette writes a file to disk when it is larger.
IN_MEMORY_BYTES = 1024 * 1024
# The least that must arrive in each further period of a body that takes longer than one period.
LEAST_BYTES = 64 * 1024
# The server reads the rest of a body after the answer, if there is no more of it.
DRAINED_BYTES = 64 * 1024


class ClientQuotas:
    """The requests with a body, and the forms on disk, of each client.

    A client has a number of requests with a body, until their answers. A further one waits, unread, for its
    place (`service.turns.Shares`). Its forms may occupy the size of the largest file, or a third of the
    temporary folder if that is less, and more only while as much stays free for each of two other clients.
    Use it in the event loop only.

    `bodies` is the most such requests of one client at a time, `largest` the size of the largest file.
    """

    def __init__(self, bodies: int, largest: int) -> None:
        self._bodies = Shares(bodies)
        self._largest = largest + FORM_OVERHEAD
        self._bytes: Counter[str] = Counter()

    async def begin(self, client: str) -> asyncio.Semaphore:
        """Wait for a place for a body of a client; return what is to be released at the end of the request.

        Raise BusyError if no request of the client has ended meanwhile.
        """
        busy = f"{self._bodies.places} requests of this client have a body; try again when one has ended"
        return await self._bodies.take(client, busy)

    def take(self, client: str, size: int) -> None:
        """Count bytes that are about to be written to the temporary folder.

        Raise StorageFullError if the folder is full, or the client has its share.
        """
        free = shutil.disk_usage(tempfile.gettempdir()).free
        share = min(self._largest, (free + self._bytes.total()) // 3)
        if size > free or (self._bytes[client] + size > share and free - size < 2 * share):
            raise StorageFullError("there is no room for the upload in the temporary folder")
        self._bytes[client] += size

    def free(self, client: str, size: int) -> None:
        """Count bytes no more: their files are closed. A client without any is forgotten."""
        self._bytes[client] -= size
        self._bytes += Counter()


@dataclass
class BodyLimit:
    """Middleware that refuses bodies that are too large, too many or stalled.

    A form may have the size of the largest file and `FORM_OVERHEAD`; any other body has a limit of
    `SMALL_BODY_BYTES`.

    `larger` has the paths whose largest file has another size than `file_bytes`. `seconds` is the longest
    wait for the next bytes of a body, and the period of `LEAST_BYTES`.
    """

    app: ASGIApp
    file_bytes: int
    larger: Mapping[str, int]
    quotas: ClientQuotas
    seconds: float

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        body = _Body(self, scope, receive)

        async def send_and_close(message: Message) -> None:
            if message["type"] == "http.response.start":
                body.answered = True
                if body.goes_on:
                    # Otherwise the server reads the rest of the body, which may have no end.
                    MutableHeaders(scope=message)["Connection"] = "close"
            await send(message)

        if body.declared > body.limit:
            await problem_of(body.too_large)(scope, receive, send_and_close)
            return
        try:
            await self.app(scope, body.receive, send_and_close)
        finally:
            body.close()


class _Body:
    """The body of one request as it arrives."""

    def __init__(self, limits: BodyLimit, scope: Scope, receive: Receive) -> None:
        headers = Headers(scope=scope)
        self._quotas, self._seconds = limits.quotas, limits.seconds
        self._scope, self._receive = scope, receive
        self._is_form = headers.get("content-type", "").lower().startswith("multipart/form-data")
        file_bytes = limits.larger.get(scope["path"], limits.file_bytes)
        self.limit = file_bytes + FORM_OVERHEAD if self._is_form else SMALL_BODY_BYTES
        taken = file_bytes if self._is_form else self.limit
        self.too_large = FileTooLargeError(f"at most {taken} bytes are taken")
        length = headers.get("content-length", "")
        self.declared = int(length) if length.isdecimal() else 0
        self._chunked = "transfer-encoding" in headers
        self._client = ""
        self._received = self._on_disk = 0
        self._waited = 0.0
        self._refusal: ServiceError | None = None
        self.answered = False
        self._place: asyncio.Semaphore | None = None
        self._whole = not (self.declared or self._chunked)

    @property
    def goes_on(self) -> bool:
        """Whether more of the body may follow than the server should read and drop."""
        if self._whole:
            return False
        return self._refusal is not None or self._chunked or self.declared - self._received > DRAINED_BYTES

    async def receive(self) -> Message:
        """Return the next message of the server."""
        if self._whole:
            return await self._receive()
        try:
            # Who waited for a turn meanwhile may have missed it.
            if self._refusal is not None:
                raise self._refusal
            return await self._next()
        except ServiceError as error:
            if self.answered:
                # There is no second answer: the stream of the first one ends.
                return {"type": "http.disconnect"}
            self._refusal = error
            raise RefusedBodyError(error) from error

    async def _next(self) -> Message:
        if self._place is None:
            # The key is known by now.
            self._client = client_of(self._scope)
            self._place = await self._quotas.begin(self._client)
        start = time.monotonic()
        try:
            async with asyncio.timeout(self._seconds):
                message = await self._receive()
        except TimeoutError:
            raise StalledBodyError(f"nothing of the body arrived in {self._seconds:g} s") from None
        # Only the time that the service waits counts, not the time in which it works.
        self._waited += time.monotonic() - start
        self._received += len(message.get("body", b""))
        if self._received < LEAST_BYTES * (self._waited / self._seconds - 1):
            raise StalledBodyError(f"{self._received} bytes of the body arrived in {self._waited:.0f} s")
        if self._received > self.limit:
            raise self.too_large
        if self._is_form and self._received > IN_MEMORY_BYTES:
            more = self._received - self._on_disk
            self._quotas.take(self._client, more)
            self._on_disk += more
        if not message.get("more_body", False):
            self._whole = True
        return message

    def close(self) -> None:
        """Free the client's room: the request is over, and its files are closed."""
        if self._place is not None:
            self._place.release()
        self._quotas.free(self._client, self._on_disk)
