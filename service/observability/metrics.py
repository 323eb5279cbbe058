"""The Prometheus metrics of the service, which `docs/operating.md` lists, and the wall times of stages."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector

PREFIX = "isoshape_"

# Seconds, from reading a record to embedding a large file.
SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 120.0)
SHAPES = (1, 10, 100, 300, 1_000, 3_000, 10_000, 100_000)

METHODS = frozenset({"GET", "HEAD", "POST", "PATCH", "PUT", "DELETE", "OPTIONS"})
# The label of values that clients choose freely; each distinct value would need memory.
OTHER = "other"


class Metrics:
    """The metrics of one service in their own registry."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._watched: dict[str, Gauge] = {}
        ProcessCollector(registry=self.registry)
        self.requests = self._counter("requests", "Requests that have ended.", "method", "route", "status")
        self.request_seconds = self._histogram(
            "request_seconds", "From a request's head to its end.", SECONDS, "method", "route"
        )
        self.requests_in_progress = self._gauge("requests_in_progress", "Requests that have not ended.")
        self.problems = self._counter("problems", "Requests answered with a problem document.", "kind")
        self.stage_seconds = self._histogram(
            "stage_seconds", "Stages of uploads, queries and comparisons.", SECONDS, "operation", "stage"
        )
        self.query_compared = self._histogram(
            "query_compared", "Stored shapes that a query was compared with.", SHAPES
        )
        self.queries_shortlisted = self._counter(
            "queries_shortlisted", "Queries that looked only at the nearest by signature."
        )
        self.worker_replacements = self._counter(
            "worker_replacements", "Worker processes that were replaced while they had a task.", "cause"
        )
        self.database_seconds = self._histogram(
            "database_seconds", "How long sessions with the database were open.", SECONDS, "session"
        )
        self.database_sessions = self._gauge("database_sessions", "Sessions with the database that are open.")
        self.database_failures = self._counter(
            "database_failures", "Sessions that ended because the database failed.", "kind"
        )

    def watch(self, name: str, about: str, value: Callable[[], float], **labels: str) -> None:
        """Register a gauge that calls a function whenever the metrics are read."""
        gauge = self._watched.get(name)
        if gauge is None:
            gauge = self._watched[name] = self._gauge(name, about, *labels)
        (gauge.labels(**labels) if labels else gauge).set_function(value)

    def stages(self, operation: str, milliseconds: Mapping[str, float]) -> None:
        """Observe the times of an operation's stages."""
        for stage, value in milliseconds.items():
            self.stage_seconds.labels(operation, stage).observe(value / 1e3)

    def _counter(self, name: str, about: str, *labels: str) -> Counter:
        return Counter(PREFIX + name, about, labels, registry=self.registry)

    def _gauge(self, name: str, about: str, *labels: str) -> Gauge:
        return Gauge(PREFIX + name, about, labels, registry=self.registry)

    def _histogram(self, name: str, about: str, buckets: tuple[float, ...], *labels: str) -> Histogram:
        return Histogram(PREFIX + name, about, labels, buckets=buckets, registry=self.registry)


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
