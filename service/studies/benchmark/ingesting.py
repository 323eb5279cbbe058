"""A folder stored over HTTP: shapes a second on all processors, and on one."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from core.io import write_mesh
from service.client.concurrent_uploads import Item, upload_all
from service.studies.benchmark.meshes import Source
from service.studies.benchmark.searching import served
from service.studies.benchmark.timing import Spread

TURNS = 3


@dataclass(frozen=True)
class IngestRow:
    """The upload of all meshes of the source to an empty archive.

    Attributes
    ----------
    processors : int
        Number of processors that the service, its workers and the client share.
    shapes : int
    a_second : Spread
        Stored shapes per second.
    """

    processors: int
    shapes: int
    a_second: Spread


def ingesting_rows(source: Source, scratch: Path, *, turns: int = TURNS) -> list[IngestRow]:
    """Measure in turn with all processors and with one.

    Raises
    ------
    OSError
        The system does not support processor affinity.
    """
    items = [
        Item(f"{number} {name}.off", write_mesh(mesh, "off"), ())
        for number, (name, mesh) in enumerate(entry for some in source.classes.values() for entry in some)
    ]
    everything = processors()
    rates: dict[int, list[float]] = {len(everything): [], 1: []}
    for turn in range(turns):
        for count, found in rates.items():
            url = f"sqlite:///{scratch / f'ingest-{turn}-{count}.sqlite3'}"
            with on(everything[:count]):
                found.append(_rate(url, items))
    return [IngestRow(count, len(items), Spread.of(found)) for count, found in rates.items()]


def processors() -> list[int]:
    """The numbers of the processors that this process may use.

    Raises
    ------
    OSError
        The system does not support processor affinity.
    """
    if not hasattr(os, "sched_getaffinity"):
        raise OSError("this system does not let a process choose its processors")
    return sorted(os.sched_getaffinity(0))


@contextmanager
def on(some: Sequence[int]) -> Iterator[None]:
    """Bind this thread, and threads and processes that it starts in the block, to some processors."""
    before = processors()
    os.sched_setaffinity(0, some)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _rate(url: str, items: Sequence[Item]) -> float:
    with served(url) as (_, client):
        began = perf_counter()
        for item, outcome in upload_all(client, items):
            if isinstance(outcome, str):
                raise RuntimeError(f"{item.name}: {outcome}")
        return len(items) / (perf_counter() - began)
