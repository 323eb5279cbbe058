"""Turns of clients at work that is limited, their shares and their pace: no client starves another."""

import asyncio
import math
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from weakref import WeakValueDictionary

from service.errors import BusyError

current_client: ContextVar[str] = ContextVar("client", default="")
"""The client that the current work is for: the digest of its key, or its address; empty for the service."""


MOST_SECONDS = 5.0
PATIENCE_SECONDS = 5.0
"""The longest wait for a place of a client's own."""


@contextmanager
def counted(numbers: Counter[str], client: str) -> Iterator[None]:
    """Count one more for a client until the end of the block. A client without any is forgotten."""
    numbers[client] += 1
    try:
        yield
    finally:
        numbers[client] -= 1
        numbers += Counter()


class Pace:
    """Delays what one client asks for too often, and nothing of others. Use it in one event loop only.

    A client is served so many times `per_second`, at equal intervals once it has had `at_once`; each time
    waits `MOST_SECONDS` at most (the generic cell rate algorithm, ITU-T I.371).
    """

    def __init__(self, per_second: float, at_once: int = 1) -> None:
        self._interval = 1 / per_second
        self._ahead = (at_once - 1) * self._interval
        # The moments at which clients would be served next at equal intervals.
        self._next: dict[str, float] = {}

    async def wait(self, client: str) -> None:
        """Wait until a client may be served."""
        now = time.monotonic()
        self._next = {name: moment for name, moment in self._next.items() if moment > now}
        moment = self._next.get(client, now)
        self._next[client] = min(moment + self._interval, now + self._ahead + MOST_SECONDS)
        await asyncio.sleep(max(0.0, moment - self._ahead - now))


class Shares:
    """Places of which each client has so many, and takes none of others. Use it in one event loop only."""

    def __init__(self, places: int) -> None:
        self.places = places
        # Clients without a place are forgotten.
        self._clients: WeakValueDictionary[str, asyncio.Semaphore] = WeakValueDictionary()

    async def take(self, client: str, busy: str) -> asyncio.Semaphore:
        """Wait for a place of a client; return what is to be released.

        Raise BusyError, with the message `busy`, if none is free after `PATIENCE_SECONDS`.
        """
        places = self._clients.setdefault(client, asyncio.Semaphore(self.places))
        try:
            async with asyncio.timeout(PATIENCE_SECONDS):
                await places.acquire()
        except TimeoutError:
            raise BusyError(busy) from None
        return places

    @asynccontextmanager
    async def taken(self, client: str, busy: str) -> AsyncIterator[None]:
        """Hold a place of a client for the duration of the block; wait and raise as `take` does."""
        places = await self.take(client, busy)
        try:
            yield
        finally:
            places.release()


class Place(asyncio.Future[None]):
    """A place at work, or the wait for it: done once the client has the place."""

    def __init__(self, client: str) -> None:
        super().__init__()
        self.client = client

    @property
    def held(self) -> bool:
        """Whether the client was given the place."""
        return self.done() and not self.cancelled() and self.exception() is None


class Turns:
    """Places at work, which clients get in turn (max-min fairness). Use it in one event loop only.

    A free place goes to the waiting client that holds the fewest, and among equals to the one that got its
    last place before the others. One place beyond `places` is for a client that holds none: a client that
    comes never waits until all work of another one, which may be long, has ended.

    Parameters
    ----------
    places : int
        The most places held at a time by clients that hold others.
    room : float
        The most places held and waited for. When all are taken, the newest wait of the client with the most
        waits gives way to a client that has fewer; one more is for a client that has none.
    kept_seconds : float
        Clients that left a place so lately come again: a place is kept for each, from clients that hold
        others; all places but one at most.
    """

    def __init__(self, places: int, room: float = math.inf, *, kept_seconds: float = 0.0) -> None:
        self.room = room
        self._places = places
        self._kept_seconds = kept_seconds
        # The moments at which clients left their last places, and the next look for places kept no longer.
        self._left: dict[str, float] = {}
        self._look: asyncio.TimerHandle | None = None
        self._held: Counter[str] = Counter()
        self._waiting: dict[str, deque[Place]] = {}
        # The number of the last place that each client inside got.
        self._last: Counter[str] = Counter()
        self._given = 0

    @property
    def inside(self) -> int:
        """The number of places held and waited for."""
        return self._held.total() + sum(map(len, self._waiting.values()))

    def ask(self) -> Place:
        """Ask for a place for the client of the current context; `leave` it in any case.

        A place that gives way to another client raises BusyError when it is awaited. Raise BusyError if there
        is no room.
        """
        place = Place(current_client.get())
        if self.inside >= self.room:
            self._make_room(place.client)
        self._waiting.setdefault(place.client, deque()).append(place)
        self._give()
        return place

    def leave(self, place: Place) -> None:
        """Free a place, or wait for it no longer."""
        if place.held:
            self._held[place.client] -= 1
            # Clients without a place are forgotten.
            self._held += Counter()
            self._left = self._lately()
            if place.client:
                self._left[place.client] = time.monotonic()
        else:
            self._forget(place)
        self._give()
        if not self._held[place.client] and place.client not in self._waiting:
            del self._last[place.client]

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for a place, and hold it for the duration of the block; raises as `ask` does."""
        place = self.ask()
        try:
            await place
            yield
        finally:
            self.leave(place)

    def _give(self) -> None:
        """Give free places to waiting clients."""
        while self._waiting:
            client = min(self._waiting, key=lambda each: (self._held[each], self._last[each]))
            held, holds_none = self._held.total(), not self._held[client]
            if held >= self._places + holds_none:
                return
            if not holds_none and held >= self._places - self._kept():
                self._look = self._look or asyncio.get_running_loop().call_later(
                    self._kept_seconds, self._give_kept
                )
                return
            place = self._waiting[client][0]
            self._forget(place)
            if not place.done():
                self._given += 1
                self._held[client] += 1
                self._last[client] = self._given
                place.set_result(None)

    def _give_kept(self) -> None:
        """Give places that are kept no longer: no client may come or leave meanwhile."""
        self._look = None
        self._give()

    def _kept(self) -> int:
        """Return the number of places that are kept for clients which hold none now."""
        return min(len(self._lately().keys() - self._held.keys()), self._places - 1)

    def _lately(self) -> dict[str, float]:
        """Return the moments at which clients left that places are kept for."""
        oldest = time.monotonic() - self._kept_seconds
        return {name: moment for name, moment in self._left.items() if moment > oldest}

    def _make_room(self, newcomer: str) -> None:
        """Refuse the newest wait of the client with the most, unless the newcomer then has more."""
        longest = max(self._waiting.values(), key=len, default=deque[Place]())
        own = len(self._waiting.get(newcomer, ()))
        busy = BusyError(f"{self.inside} requests are at work or waiting; try again later")
        if len(longest) > own + 1:
            place = longest[-1]
            self._forget(place)
            if not place.done():
                place.set_exception(busy)
        elif own or self._held[newcomer] or self.inside > self.room:
            raise busy

    def _forget(self, place: Place) -> None:
        """Take a place out of those that are waited for."""
        waits = self._waiting.get(place.client, deque[Place]())
        if place in waits:
            waits.remove(place)
            if not waits:
                del self._waiting[place.client]
