"""The cost of the service: queries of archives of several sizes, and a folder stored, over HTTP."""

import os
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean, median
from time import perf_counter, sleep
from typing import Any
from uuid import uuid4

import numpy as np

from core.embedding import Embedding
from core.io import write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.diffusion import NEIGHBOURS
from service.client import Client
from service.client.clients import Item, upload_all
from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import ready_to_store
from service.evaluation.benchmark_method import Spread, all_meshes
from service.evaluation.benchmark_shapes import Source, nearest, shaken
from service.index.neighbour_repository import columns_of
from service.pipelines.active import Pipelines, begin
from service.search.schemas import RankBy
from service.server.process import LOOPBACK, ChildService, bind, wait_until_ready
from service.settings import Settings
from service.shapes import file_repository
from service.shapes.records import NewFile
from service.storage.database import Database, migrate, next_revision
from service.storage.tables import NeighboursRow, ShapeRow

SIZES = (380, 1_000, 10_000, 100_000)
"""Shapes of the archives that are queried."""

QUERIES, LONG, CHECKED = 100, 20, 40
"""Numbers of queries: of an archive, of a large one searched exhaustively, and of the check of shortlists."""

IDLE, SETTLED_BY = 0.1, 1800.0
"""Seconds of processor time in a second below which a service is idle, and the longest wait for that."""

EXHAUSTIVE = 10_000
"""The size up to which archives are also searched exhaustively."""

SHORTLIST_FROM: int = Settings.model_fields["shortlist_from"].default
"""The size from which a query compares only a shortlist, unless it is told to compare every shape."""

CHECKED_RANKINGS: tuple[RankBy, ...] = ("cc", "combined")
RANKINGS: tuple[RankBy, ...] = (*CHECKED_RANKINGS, "contextual")

RECORD_BYTES = 110_000
"""Memory with room for the match record and the descriptors of a shape, of which it may take a third."""

LENGTHS = ((150, 10), (300, 20), (600, 40), (900, 60), (1_200, 80), (2_400, 160))
"""Lengths of the shortlist, and shapes compared in full besides the requested results."""

WIDE = (6_000, 1_000)
"""The lengths that stand for exhaustive search, which takes minutes, among more than `EXHAUSTIVE` shapes."""

MOST_EXCLUDED = 500
"""Ids that a query may exclude."""

FILE_VERTICES = 3_000
"""Vertices of the file of a query, about."""

GRAPH = 10_000
"""Shapes of the archive whose graph of neighbours is made."""

TURNS = 3
"""Measurements of a folder stored."""

AT_ONCE = 2_000
"""Shapes written in one transaction."""

SIDES = dict.fromkeys(("bounding_box", "file_box", "gyration_radii"), (1.0, 1.0, 1.0))
"""The boxes and the radii of gyration of all shapes."""

STEP = 7919
"""The step between the numbers of shapes that are mixed or queried, coprime to all sizes."""

OFFSETS = np.delete(np.arange(-NEIGHBOURS // 2, NEIGHBOURS // 2 + 1), NEIGHBOURS // 2)
"""Places of the neighbours of a shape in the order of the copies, from its own."""

Original = tuple[str, Embedding]
"""The class and the embedding of a shape of the source."""


def originals(source: Source) -> list[Original]:
    """Return all meshes of the source with embeddings by the default parameters."""
    method = Pipeline(DEFAULT)
    return [(label, method.embed(mesh)) for label, meshes in source.items() for _, mesh in meshes]


def fill(url: str, source: Sequence[Original], count: int, *, graph: bool = True) -> list[str]:
    """Fill an archive with `count` shapes and return their ids: the originals, then noisy copies in turn.

    A file of a few bytes replaces each mesh. With `graph`, the neighbours of a shape are the copies of the
    same original whose numbers are nearest, and perhaps that original.
    """
    ids: list[str] = []
    first = 0
    with closing(Database(url, lock_seconds=60.0)) as database:
        migrate(database)
        begin(Pipelines(DEFAULT), database)
        while len(ids) < count:
            with database.write() as session:
                now, revision = datetime.now(UTC), next_revision(session)
                for number in range(len(ids), min(len(ids) + AT_ONCE, count)):
                    label, embedding = source[number % len(source)]
                    if number >= len(source):
                        _, other = source[number // len(source) * STEP % len(source)]
                        embedding = shaken(embedding, number, other)
                    file = NewFile(number.to_bytes(8, "big"), "off")
                    embedded = ready_to_store(embedding, SIDES, {})
                    blob = file_repository.add_blob(session, file.data, file.sha256)
                    file_repository.add_embedding(session, blob, "off", DEFAULT.fingerprint, embedded)
                    ids.append(str(uuid4()))
                    name = f"{label} {number}"
                    row = {"id": ids[-1], "collection_number": DEFAULT_COLLECTION.number, "blob_number": blob}
                    row |= {"format": "off", "name": name, "folded_name": name.casefold(), "meta": {}}
                    row |= {"facts": embedded.facts, "created_at": now, "updated_at": now}
                    shape = session.insert(ShapeRow, row | {"revision": revision, "checksum": ""})
                    first = first or shape
                    if not graph:
                        continue
                    others = shape + len(source) * OFFSETS
                    there = (others >= first) & (others < first + count)
                    row = columns_of(DEFAULT.fingerprint, shape, others[there], -np.abs(OFFSETS[there]))
                    session.insert(NeighboursRow, row)
    return ids


def searching_rows(
    source: Source, scratch: Path, *, sizes: Sequence[int] = SIZES, queries: int = QUERIES
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Fill an archive of each size and query it, by the ids of shapes spread over it and by a file.

    The stages are compared with exhaustive search on the largest archive.
    """
    rows: list[dict[str, Any]] = []
    cascades: list[dict[str, Any]] = []
    shapes = originals(source)
    ((_, mesh),) = nearest(all_meshes(source), FILE_VERTICES, 1)
    file = write_mesh(mesh, "ply")
    for size in sizes:
        path = scratch / f"{size}.sqlite3"
        url = f"sqlite:///{path}"
        ids = fill(url, shapes, size)
        rows += _measured(url, ids, file, queries, exhaustive=False)
        if SHORTLIST_FROM <= size <= EXHAUSTIVE:
            rows += _measured(url, ids, file, min(queries, LONG), exhaustive=True)
        if size == max(sizes) and size > len(shapes):
            for ranking in CHECKED_RANKINGS:
                cascades += cascade_rows(url, shapes, ids, ranking, min(queries, CHECKED))
        path.unlink()
    return rows, cascades


def cascade_rows(
    url: str, source: Sequence[Original], ids: Sequence[str], rank_by: RankBy, queries: int
) -> list[dict[str, Any]]:
    """Measure each choice of stage lengths against exhaustive search, or `WIDE`, which is the last row.

    Queries are originals among `ids`; the answers exclude their copies. A length of None is all shapes.
    `same_first` is the share of queries with the same first result as the last row, `recall_3` and
    `recall_10` the shares of its first results that are among as many here, `first_of_class` and
    `ten_of_class` the share of first results, and of the first ten, of the query's class.
    """
    size = len(ids)
    labels = {id: source[number % len(source)][0] for number, id in enumerate(ids)}
    asked = [ids[number * STEP % len(source)] for number in range(min(queries, len(source)))]
    measured: dict[tuple[int, int] | None, tuple[list[list[str]], float]] = {}
    widest = None if size <= EXHAUSTIVE else WIDE
    for length in (*LENGTHS, widest):
        shortlist, finalists = length or (size, size)
        settings = {"shortlist_from": 1, "shortlist_length": shortlist, "finalists": finalists}
        if length is None:
            settings["search_bytes"] = RECORD_BYTES * size
        with served(url, **settings) as (service, client):
            wait_until_idle(service)
            answers, seconds = [], []
            for query in asked:
                copies = ids[ids.index(query) :: len(source)][:MOST_EXCLUDED]
                before = perf_counter()
                answer = client.query_shape(
                    query, rank_by=rank_by, exhaustive=length is None, exclude=copies, top_k=10
                )
                seconds.append(perf_counter() - before)
                answers.append([result.shape.id for result in answer.results])
            measured[length] = answers, 1e3 * float(np.median(seconds))
    wanted = measured[widest][0]
    rows = []
    for length, (answers, median_ms) in measured.items():
        right = [
            [labels[id] == labels[query] for id in results]
            for query, results in zip(asked, answers, strict=True)
        ]
        same = [results[0] == best[0] for results, best in zip(answers, wanted, strict=True)]
        row: dict[str, Any] = {"ranked_by": rank_by, "shapes": size, "queries": len(asked)}
        row |= zip(("shortlist", "in_full"), length or (None, None), strict=True)
        row |= {"same_first": fmean(same), "recall_3": _recall(answers, wanted, 3)}
        row |= {"recall_10": _recall(answers, wanted, 10)}
        row |= {"first_of_class": fmean(each[0] for each in right)}
        rows.append(row | {"ten_of_class": fmean(map(fmean, right)), "median_ms": median_ms})
    return rows


def _recall(answers: Sequence[list[str]], wanted: Sequence[list[str]], count: int) -> float:
    """Return the mean share of the first `count` wanted results among as many answered."""
    return fmean(
        len(set(results[:count]) & set(best[:count])) / len(best[:count])
        for results, best in zip(answers, wanted, strict=True)
    )


def graph_rows(source: Source, scratch: Path, *, size: int = GRAPH) -> list[dict[str, Any]]:
    """Measure how long a service takes to make the graph of neighbours of an archive without one.

    `memory_mib` is the memory of its main process at the end.
    """
    url = f"sqlite:///{scratch / 'graph.sqlite3'}"
    ids = fill(url, originals(source), size, graph=False)
    began = perf_counter()
    with served(url, duplicates_in_background=True) as (service, client):
        while not client.suggestions(ids[-1]).known or client.families().unknown:
            sleep(1.0)
        row = {"shapes": size, "seconds": perf_counter() - began, "memory_mib": service.memory() / 2**20}
    return [row]


def ingesting_rows(source: Source, scratch: Path, *, turns: int = TURNS) -> list[dict[str, Any]]:
    """Upload all meshes to an empty archive, in turn with all processors and with one.

    With all, the graph of neighbours is made meanwhile, or not. The service, its workers and the client share
    the processors. Raise OSError if the system does not support processor affinity.
    """
    items = [
        Item(f"{number} {name}.off", write_mesh(mesh, "off"), ())
        for number, (name, mesh) in enumerate(all_meshes(source))
    ]
    available = processors()
    rates: dict[tuple[int, bool], list[float]] = {
        (len(available), False): [],
        (len(available), True): [],
        (1, False): [],
    }
    for turn in range(turns):
        for (count, graph), measured in rates.items():
            url = f"sqlite:///{scratch / f'ingest-{turn}-{count}-{graph}.sqlite3'}"
            with bound_to(available[:count]):
                measured.append(_rate(url, items, graph=graph))
    return [
        {"processors": count, "graph": graph, "shapes": len(items), "shapes_a_second": Spread.of(measured)}
        for (count, graph), measured in rates.items()
    ]


def processors() -> list[int]:
    """Return the numbers of the processors that this process may use.

    Raise OSError if the system does not support processor affinity.
    """
    if not hasattr(os, "sched_getaffinity"):
        raise OSError("this system does not let a process choose its processors")
    return sorted(os.sched_getaffinity(0))


@contextmanager
def bound_to(chosen: Sequence[int]) -> Iterator[None]:
    """Bind this thread, and threads and processes that it starts in the block, to some processors."""
    before = processors()
    os.sched_setaffinity(0, chosen)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def served(url: str, **settings: int | str) -> Iterator[tuple[ChildService, Client]]:
    """Yield a ready service, which does not search for duplicates in the background, and its client."""
    with bind(LOOPBACK, 0) as bound:
        port = bound.getsockname()[1]
    settings = {"duplicates_in_background": False, **settings}
    changed = {f"ISOSHAPE_{name.upper()}": str(value) for name, value in settings.items()}
    given = {"ISOSHAPE_DATABASE_URL": url, "ISOSHAPE_LOG_LEVEL": "error", **changed}
    with ChildService(port, given, quiet=True) as service, Client(service.url) as client:
        wait_until_ready(client, service.ended)
        yield service, client


def wait_until_idle(service: ChildService) -> None:
    """Wait for three idle seconds: then the cache of match records is full.

    Raise TimeoutError if the service is at work for too long.
    """
    latest, quiet = perf_counter() + SETTLED_BY, 0
    used = service.processor_seconds()
    while quiet < 3:
        if perf_counter() > latest:
            raise TimeoutError(f"the service is not idle after {SETTLED_BY:.0f} s")
        sleep(1.0)
        before, used = used, service.processor_seconds()
        quiet = quiet + 1 if used - before < IDLE else 0


def _measured(
    url: str, ids: Sequence[str], file: bytes, queries: int, *, exhaustive: bool
) -> list[dict[str, Any]]:
    """Measure the queries of one archive by each ranking, the first apart; and `LONG` queries by a file.

    `compared` is the number of shapes that the last query by id compared in full, `start_s` from the start of
    the process until it is ready. `processor_ms` is the processor time of the main process for a query by id,
    the mean, and `memory_mib` its memory at the end. The service reports the stages.
    """
    rows: list[dict[str, Any]] = []
    began = perf_counter()
    with served(url) as (service, client):
        start = perf_counter() - began
        wait_until_idle(service)
        for ranking in RANKINGS:
            options = {"rank_by": ranking, "exhaustive": exhaustive}
            times, stages, compared, used = [], [], 0, 0.0
            for number in range(queries + 1):
                if number == 1:
                    used = service.processor_seconds()
                before = perf_counter()
                answer = client.query_shape(ids[number * STEP % len(ids)], **options)
                times.append(1e3 * (perf_counter() - before))
                stages.append(answer.milliseconds)
                compared = answer.compared
            processor_ms = 1e3 * (service.processor_seconds() - used) / queries
            by_file = []
            for _ in range(min(queries, LONG)):
                before = perf_counter()
                client.query_file(("query.ply", file), **options)
                by_file.append(1e3 * (perf_counter() - before))
            row: dict[str, Any] = {"shapes": len(ids), "exhaustive": exhaustive, "ranked_by": ranking}
            row |= {"compared": compared, "queries": queries, "start_s": start, "first_ms": times[0]}
            p50, p95 = np.percentile(times[1:], [50, 95]).tolist()
            medians = {name: median(stage[name] for stage in stages[1:]) for name in stages[0]}
            row |= {"median_ms": p50, "p95_ms": p95, "by_file_ms": median(by_file), "stages_ms": medians}
            row |= {"processor_ms": processor_ms, "memory_mib": service.memory() / 2**20}
            rows.append(row)
    return rows


def _rate(url: str, items: Sequence[Item], *, graph: bool) -> float:
    with served(url, duplicates_in_background=graph) as (_, client):
        began = perf_counter()
        for item, outcome in upload_all(client, items):
            if isinstance(outcome, str):
                raise RuntimeError(f"{item.name}: {outcome}")
        return len(items) / (perf_counter() - began)
