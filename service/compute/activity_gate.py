"""A gate that background work waits at while requests of users run."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager


class ActivityGate:
    """Counts running requests, so that background work can wait until there are none; for one event loop."""

    def __init__(self) -> None:
        self._count = 0
        self._nothing = asyncio.Event()
        self._nothing.set()

    @contextmanager
    def one(self) -> Iterator[None]:
        """Count one request for the duration of the block."""
        self._count += 1
        self._nothing.clear()
        try:
            yield
        finally:
            self._count -= 1
            if not self._count:
                self._nothing.set()

    async def nothing(self) -> None:
        """Wait until no request runs."""
        await self._nothing.wait()
