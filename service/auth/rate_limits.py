"""Rate limits of API keys."""

import math
import time
from collections.abc import Callable


class RateLimit:
    """A rate limit per key: a burst of `per_minute` requests, and as many per minute after it.

    The generic cell rate algorithm (ITU-T I.371) on a monotonic clock stores one number per key and gives the
    exact time of the next admitted request. The library `limits` uses the wall clock and starts a thread per
    request.

    Parameters
    ----------
    per_minute : int
        Requests per minute; 0 is no limit.
    """

    def __init__(self, per_minute: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._interval = 60.0 / per_minute if per_minute else 0.0
        self._clock = clock
        self._empty_at: dict[str, float] = {}

    def wait(self, key: str) -> int | None:
        """Count a request: None if it is admitted, else the number of seconds until the next one is."""
        if not self._interval:
            return None
        now = self._clock()
        # The time at which the bucket, which loses one request per interval, becomes empty.
        empty_at = max(self._empty_at.get(key, now), now) + self._interval
        excess = empty_at - now - 60.0
        # The tolerance covers rounding of the sum of many intervals.
        if excess > 1e-6:
            return max(1, math.ceil(excess))
        self._empty_at[key] = empty_at
        return None
