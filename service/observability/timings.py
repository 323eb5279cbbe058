"""How long each stage of an answer took."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Timings:
    """Wall time by stage, in milliseconds, since it was made."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._start = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block."""
        start = time.perf_counter()
        yield
        self.milliseconds[name] = 1e3 * (time.perf_counter() - start)

    def so_far(self) -> dict[str, float]:
        """The stages, and "total" since the beginning, rounded to a microsecond."""
        total = 1e3 * (time.perf_counter() - self._start)
        return {name: round(value, 3) for name, value in {**self.milliseconds, "total": total}.items()}
