"""Middleware of every request: an id, a count, a line in the log, and access control."""

import asyncio
import logging
import re
import time
import uuid
from collections.abc import Awaitable, Coroutine
from typing import Any, NoReturn, TypeVar

from h11 import LocalProtocolError
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.auth.gate import PROBES, Gate
from service.errors import ServiceError, ShuttingDownError
from service.http.problems import KIND_IN_SCOPE, problem_of, problem_response
from service.observability.logging import get_logger, request_id
from service.observability.metrics import METHODS, OTHER, Metrics
from service.turns import Pace, current_client

# Keys of the request's scope: the digest of its API key, for the log, and its grant.
KEY_IN_SCOPE = "isoshape.key"
GRANT_IN_SCOPE = "isoshape.grant"
# The name of the collection that the request works in, once it is known.
COLLECTION_IN_SCOPE = "isoshape.collection"
# As many requests of one client, and refusals among them, as leave the event loop to others. A page asks for
# its files and pictures at once.
REQUESTS_PER_SECOND, REQUESTS_AT_ONCE, REFUSALS_PER_SECOND = 200, 200, 20


class AccessControl:
    """Middleware that asks the gate about each request."""

    def __init__(self, app: ASGIApp, gate: Gate) -> None:
        self._app = app
        self._gate = gate
        self._pace = Pace(REQUESTS_PER_SECOND, REQUESTS_AT_ONCE)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            grant = self._gate.admit(scope["method"], scope["path"], headers)
        except ServiceError as error:
            await problem_of(error)(scope, receive, send)
            return
        scope[GRANT_IN_SCOPE] = grant
        if grant is not None and grant.digest is not None:
            scope[KEY_IN_SCOPE] = grant.digest
        client = client_of(scope)
        current_client.set(client)
        await self._pace.wait(client)
        await self._app(scope, receive, send)


def client_of(scope: Scope) -> str:
    """Return the client of an admitted request: the digest of its key, or its address without keys."""
    digest, peer = scope.get(KEY_IN_SCOPE), scope.get("client")
    return str(digest or (peer[0] if peer else ""))


HEADER = "X-Request-ID"

# Answers that change with what is stored, and may be for one key only.
_PRIVATE = ("application/json", "application/problem+json", "text/csv", "application/vnd.")
# Answers without any work: too many of them would be work.
REFUSALS = frozenset(
    {"body-too-large", "busy", "cross-site", "forbidden", "misdirected-request", "rate-limit", "unauthorized"}
)
# No answer: the client disconnected. Proxies use the same number.
CLIENT_GONE = 499

log = get_logger("access")

_ACCEPTABLE_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


class RequestContext:
    """Gives a request its id, logs and counts its answer, and answers 500 or 503 to an unhandled error."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics
        self._pace = Pace(REFUSALS_PER_SECOND)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        received = Headers(scope=scope)
        sent_id = received.get(HEADER, "")
        # A proxy in front may have measured the body otherwise (RFC 9112, section 6.3).
        ambiguous = "content-length" in received and "transfer-encoding" in received
        identifier = sent_id if _ACCEPTABLE_ID.fullmatch(sent_id) else uuid.uuid4().hex
        token = request_id.set(identifier)
        status = 0
        start = time.perf_counter()
        self._metrics.requests_in_progress.inc()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                if scope.get(KIND_IN_SCOPE) in REFUSALS:
                    await self._pace.wait(client_of(scope))
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers[HEADER] = identifier
                headers["X-Content-Type-Options"] = "nosniff"
                if ambiguous:
                    headers["Connection"] = "close"
                if "etag" not in headers and headers.get("content-type", "").startswith(_PRIVATE):
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            await self._app(scope, receive, send_with_id)
        except ClientDisconnect:
            log.info("the client went away")
            status = status or CLIENT_GONE
        except LocalProtocolError:
            # The body is not HTTP: the server has answered 400 itself and closes the connection.
            while (await receive())["type"] != "http.disconnect":
                pass
        except asyncio.CancelledError:
            # The server stops, and waits no longer.
            if status:
                raise
            error = ShuttingDownError(
                "the service stopped before the work ended; the work may have changed something"
            )
            await problem_of(error)(scope, receive, send_with_id)
        except Exception as error:
            log.error("the service failed", exc_info=error)
            if status == 0:
                response = problem_response("internal-error", "the service failed; its log says more")
                await response(scope, receive, send_with_id)
        finally:
            seconds = time.perf_counter() - start
            self._count(scope, status, seconds)
            fields: dict[str, object] = {
                "method": scope["method"],
                "path": scope["path"],
                "status": status,
                "milliseconds": round(1e3 * seconds, 1),
                "problem": scope.get(KIND_IN_SCOPE),
                "collection": scope.get(COLLECTION_IN_SCOPE),
                # Enough of the digest to tell keys apart; nobody can compute the key from it.
                "key": scope.get(KEY_IN_SCOPE, "")[:8] or None,
            }
            fields = {name: value for name, value in fields.items() if value is not None}
            # Probes come every few seconds.
            level = logging.DEBUG if scope["path"] in PROBES else logging.INFO
            log.log(level, "request", extra={"fields": fields})
            request_id.reset(token)

    def _count(self, scope: Scope, status: int, seconds: float) -> None:
        """Count a request by its route, since addresses with ids have no limit in number."""
        metrics = self._metrics
        method = scope["method"] if scope["method"] in METHODS else OTHER
        route = getattr(scope.get("route"), "path", OTHER)
        metrics.requests_in_progress.dec()
        metrics.requests.labels(method, route, str(status)).inc()
        metrics.request_seconds.labels(method, route).observe(seconds)
        if KIND_IN_SCOPE in scope:
            metrics.problems.labels(scope[KIND_IN_SCOPE]).inc()


Answer = TypeVar("Answer")


async def while_connected(request: Request, work: Awaitable[Answer]) -> Answer:
    """Return the result of the work. A body that has not been read by now is dropped.

    The work is cancelled when the client disconnects, and when the server stops. A transaction goes on in its
    thread, and is committed whole or not at all. Raise ClientDisconnect if the client disconnected, and
    RefusedBodyError if the request has a body, which nobody reads, and the body is refused.
    """

    async def left() -> NoReturn:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        raise ClientDisconnect

    return await unless(left(), work)


async def unless(watch: Coroutine[Any, Any, NoReturn], work: Awaitable[Answer]) -> Answer:
    """Return the result of the work, or raise the error of the watch if that comes first; end both."""
    doing, watching = asyncio.ensure_future(work), asyncio.ensure_future(watch)
    try:
        await asyncio.wait({doing, watching}, return_when=asyncio.FIRST_COMPLETED)
        return doing.result() if doing.done() else watching.result()
    finally:
        doing.cancel()
        watching.cancel()
        # Nobody waits for either, so errors of the cancelled tasks are dropped.
        await asyncio.gather(doing, watching, return_exceptions=True)
