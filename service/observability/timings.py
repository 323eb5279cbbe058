"""Wall times of the stages of an answer."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Timings:
    """Wall times by stage in milliseconds, from the construction of the object."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._start = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block, and add its time to that of earlier blocks of the stage."""
        start = time.perf_counter()
        yield
        taken = 1e3 * (time.perf_counter() - start)
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + taken

    def so_far(self) -> dict[str, float]:
        """Return the times of the stages and their "total" up to now, rounded to a microsecond."""
        total = 1e3 * (time.perf_counter() - self._start)
        return {name: round(value, 3) for name, value in {**self.milliseconds, "total": total}.items()}
