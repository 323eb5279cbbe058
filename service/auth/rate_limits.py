"""How often a key may ask."""

import math
import time
from collections.abc import Callable


class RateLimit:
    """A bucket a key: so many requests at once, and as many a minute on end.

    The generic cell rate algorithm (ITU-T I.371) on a clock that is never set back: one number a key, and the
    very second at which the next request passes. Kept libraries were looked at: `limits` goes by the wall
    clock, and starts a thread for each request.

    Parameters
    ----------
    per_minute : int
        0 is no limit.
    """

    def __init__(self, per_minute: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._interval = 60.0 / per_minute if per_minute else 0.0
        self._clock = clock
        self._empty_at: dict[str, float] = {}

    def wait(self, key: str) -> int | None:
        """Count a request; None when it passes, else the whole seconds to wait before the next one does."""
        if not self._interval:
            return None
        now = self._clock()
        # When the bucket, which empties by one request an interval, would be empty.
        empty_at = max(self._empty_at.get(key, now), now) + self._interval
        excess = empty_at - now - 60.0
        # Sums of many intervals round.
        if excess > 1e-6:
            return max(1, math.ceil(excess))
        self._empty_at[key] = empty_at
        return None
