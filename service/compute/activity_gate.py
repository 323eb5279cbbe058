"""How much is at work that users wait for."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager


class ActivityGate:
    """Counts what is at work, so that what no user waits for can give way to it. Of one event loop."""

    def __init__(self) -> None:
        self._count = 0
        self._nothing = asyncio.Event()
        self._nothing.set()

    @contextmanager
    def one(self) -> Iterator[None]:
        """Count one as at work meanwhile."""
        self._count += 1
        self._nothing.clear()
        try:
            yield
        finally:
            self._count -= 1
            if not self._count:
                self._nothing.set()

    async def nothing(self) -> None:
        """Wait until nothing is."""
        await self._nothing.wait()
