"""Queries over HTTP against archives of several sizes: time, and results that the stages miss."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from service.client import Client
from service.search.rank_by import RankBy
from service.server.process import LOOPBACK, ChildService, bind, wait_until_ready
from service.settings import Settings
from service.studies.benchmark.archive import STEP, Original, fill, label_of, shape_id
from service.studies.benchmark.timing import growth_exponent

SIZES = (380, 1_000, 10_000, 100_000)
QUERIES, LONG, CHECKED = 100, 20, 40
"""Numbers of queries: of an archive, of a large one searched exhaustively, and of the check of shortlists."""
IDLE, SETTLED_BY = 0.1, 300.0
"""Seconds of processor time in a second below which a service is idle, and the longest wait for that."""
EXHAUSTIVE = 10_000
"""The size up to which archives are also searched exhaustively."""
SHORTLIST_FROM: int = Settings.model_fields["shortlist_from"].default
"""The size from which a query compares only a shortlist, unless it is told to compare every shape."""

RANKINGS: tuple[RankBy, ...] = ("cc", "combined")

LENGTHS = (
    (250, 50, 10),
    (500, 100, 10),
    (1_000, 200, 20),
    (1_000, 300, 20),
    (2_000, 400, 30),
    (4_000, 800, 60),
)
"""Shapes in coarse ranking, in re-ranking, and compared in full besides the requested results."""


@dataclass(frozen=True)
class SearchRow:
    """Query times of one archive.

    Attributes
    ----------
    shapes : int
    exhaustive : bool
        Whether queries asked for a comparison with every shape.
    compared : int
        Number of shapes that the last query compared in full.
    start : float
        Seconds from the start of the process until it is ready.
    first, median, p95 : float
        Seconds of the first query, and of the others.
    stages : dict of str to float
        Median seconds of a query's stages, as reported by the service.
    queries : int
    memory : int
        Memory of the service's main process at the end, in bytes.
    """

    shapes: int
    exhaustive: bool
    compared: int
    start: float
    first: float
    median: float
    p95: float
    stages: dict[str, float]
    queries: int
    memory: int


@dataclass(frozen=True)
class CascadeRow:
    """The stages of a search against exhaustive search of one archive.

    Attributes
    ----------
    rank_by : str
        The score that ranks the answers.
    shapes, queries : int
        Queries are originals; the answers exclude their copies.
    length, reranked, finalists : int or None
        Shapes in coarse ranking, in re-ranking, and compared in full besides the requested results; None is
        all.
    first : float
        Share of queries with the same first result as exhaustive search.
    nn, ten : float
        Share of first results, and of the first ten, of the query's class.
    median : float
        Median time in seconds.
    """

    rank_by: str
    shapes: int
    queries: int
    length: int | None
    reranked: int | None
    finalists: int | None
    first: float
    nn: float
    ten: float
    median: float


def by_default(rows: Sequence[SearchRow]) -> list[SearchRow]:
    """The rows of queries that left the choice of candidates to the service."""
    return [row for row in rows if not row.exhaustive]


def exponents(rows: Sequence[SearchRow]) -> tuple[float, float]:
    """The exponents of a query's median seconds and of memory as powers of the number of shapes."""
    sizes = [row.shapes for row in rows]
    return growth_exponent(sizes, [row.median for row in rows]), growth_exponent(
        sizes, [row.memory for row in rows]
    )


def searching_rows(
    source: Sequence[Original],
    scratch: Path,
    *,
    sizes: Sequence[int] = SIZES,
    queries: int = QUERIES,
    told: Callable[[int], object] = lambda written: None,
) -> tuple[list[SearchRow], list[CascadeRow]]:
    """Fill an archive of each size and query it by the ids of shapes spread over it.

    The stages are compared with exhaustive search on the largest archive searched exhaustively.
    """
    rows: list[SearchRow] = []
    kept: list[CascadeRow] = []
    checked = max((size for size in sizes if size <= EXHAUSTIVE), default=0)
    for size in sizes:
        path = scratch / f"{size}.sqlite3"
        url = f"sqlite:///{path}"
        fill(url, source, size, told)
        rows.append(_measured(url, size, queries, exhaustive=False))
        if SHORTLIST_FROM <= size <= EXHAUSTIVE:
            rows.append(_measured(url, size, min(queries, LONG), exhaustive=True))
        if size == checked and size > len(source):
            kept = [row for by in RANKINGS for row in cascade_rows(url, source, size, rank_by=by)]
        path.unlink()
    return rows, kept


@contextmanager
def served(url: str, **settings: int) -> Iterator[tuple[ChildService, Client]]:
    """A ready service on an archive, which does not search for duplicates in the background, and a client."""
    with bind(LOOPBACK, 0) as bound:
        port = bound.getsockname()[1]
    settings = {"duplicates_in_background": False, **settings}
    changed = {f"ISOSHAPE_{name.upper()}": str(value) for name, value in settings.items()}
    given = {"ISOSHAPE_DATABASE_URL": url, "ISOSHAPE_LOG_LEVEL": "error", **changed}
    with ChildService(port, given, quiet=True) as service, Client(service.url) as client:
        wait_until_ready(client, service.ended)
        yield service, client


def _wait_until_idle(service: ChildService) -> None:
    """Wait for three idle seconds: then the cache of match records is full.

    Raises
    ------
    TimeoutError
        The service is at work for too long.
    """
    latest, quiet = perf_counter() + SETTLED_BY, 0
    used = service.processor_seconds()
    while quiet < 3:
        if perf_counter() > latest:
            raise TimeoutError(f"the service is not idle after {SETTLED_BY:.0f} s")
        sleep(1.0)
        before, used = used, service.processor_seconds()
        quiet = quiet + 1 if used - before < IDLE else 0


def _measured(url: str, size: int, queries: int, *, exhaustive: bool) -> SearchRow:
    began = perf_counter()
    with served(url) as (service, client):
        start = perf_counter() - began
        _wait_until_idle(service)
        seconds, stages, compared = [], [], 0
        for number in range(queries + 1):
            before = perf_counter()
            answer = client.query_shape(shape_id(number * STEP % size), exhaustive=exhaustive)
            seconds.append(perf_counter() - before)
            stages.append(answer.milliseconds)
            compared = answer.compared
        return SearchRow(
            shapes=size,
            exhaustive=exhaustive,
            compared=compared,
            start=start,
            first=seconds[0],
            median=float(np.median(seconds[1:])),
            p95=float(np.percentile(seconds[1:], 95)),
            stages={name: float(np.median([1e-3 * one[name] for one in stages[1:]])) for name in stages[0]},
            queries=queries,
            memory=service.memory(),
        )


def cascade_rows(
    url: str,
    source: Sequence[Original],
    size: int,
    *,
    rank_by: RankBy = "cc",
    queries: int = CHECKED,
    lengths: Sequence[tuple[int, int, int]] = LENGTHS,
) -> list[CascadeRow]:
    """Each choice of stage lengths against exhaustive search, which is the last row."""
    asked = [number * STEP % len(source) for number in range(min(queries, len(source)))]
    found: dict[tuple[int, int, int] | None, tuple[list[list[str]], float]] = {}
    for length in (*lengths, None):
        most, reranked, finalists = length or (size, size, size)
        settings = {
            "shortlist_from": 1,
            "shortlist_length": most,
            "reranked": reranked,
            "finalists": finalists,
        }
        with served(url, **settings) as (service, client):
            _wait_until_idle(service)
            answers, seconds = [], []
            for number in asked:
                copies = [shape_id(copy) for copy in range(number, size, len(source))]
                before = perf_counter()
                answer = client.query_shape(
                    shape_id(number), rank_by=rank_by, exhaustive=length is None, exclude=copies, top_k=10
                )
                seconds.append(perf_counter() - before)
                answers.append([result.shape.name for result in answer.results])
            found[length] = answers, float(np.median(seconds))
    truth = found[None][0]
    rows = []
    for length, (answers, median) in found.items():
        right = [
            [source[number].label == label_of(name) for name in names]
            for number, names in zip(asked, answers, strict=True)
        ]
        rows.append(
            CascadeRow(
                rank_by=rank_by,
                shapes=size,
                queries=len(asked),
                length=None if length is None else length[0],
                reranked=None if length is None else length[1],
                finalists=None if length is None else length[2],
                first=float(np.mean([a[0] == b[0] for a, b in zip(answers, truth, strict=True)])),
                nn=float(np.mean([one[0] for one in right])),
                ten=float(np.mean([np.mean(one) for one in right])),
                median=median,
            )
        )
    return rows
