"""Work that ends when its client disconnects."""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect, Request

Answer = TypeVar("Answer")


async def while_connected(request: Request, work: Coroutine[Any, Any, Answer]) -> Answer:
    """The result of the work. A body that has not been read by now is dropped.

    The work is cancelled when the client disconnects, and when the server stops. A transaction goes on in its
    thread, and is committed whole or not at all.

    Raises
    ------
    ClientDisconnect
        The client disconnected.
    RefusedBodyError
        The request has a body, which nobody reads, and the body is refused.
    """
    doing = asyncio.ensure_future(work)
    leaving = asyncio.ensure_future(_left(request))
    try:
        await asyncio.wait({doing, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not doing.done():
            leaving.result()
            raise ClientDisconnect
        return doing.result()
    finally:
        doing.cancel()
        leaving.cancel()
        # Nobody waits for either, so errors of the cancelled tasks are dropped.
        await asyncio.gather(doing, leaving, return_exceptions=True)


async def _left(request: Request) -> None:
    """Return when the client has disconnected."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
