"""What one process and what two do of the same work with nothing between them: the most for two workers."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from core.io import Limits
from core.matching.match_records import match_record, score_match_records
from core.parameters import DEFAULT
from core.serialization import embedding_from_bytes
from service.compute.pool import LocalPool
from service.compute.tasks import embed_file, warm

TURNS = 5


def ceilings(files: Sequence[bytes], seconds: float) -> dict[str, tuple[float, float]]:
    """How much one process does in a second, and how much two: of embedding and of matching.

    Medians of turns, in each of which one process works, and then both.
    """
    found = {}
    with LocalPool(2, seconds=600, warm=partial(warm, DEFAULT)) as pool:
        records = [pool.submit(embed_file, file, "ply", Limits(), DEFAULT).result().record for file in files]
        work: dict[str, tuple[Callable[..., float], Sequence[bytes]]] = {
            "ingest": (embeds, files),
            "query": (matches, records),
        }
        for name, (function, arguments) in work.items():

            def rate(many: int, call: tuple[Any, ...] = (function, arguments, seconds)) -> float:
                return sum(task.result() for task in [pool.submit(*call) for _ in range(many)])

            rates = np.array([[rate(1), rate(2)] for _ in range(TURNS)])
            one, two = np.median(rates, axis=0).tolist()
            found[name] = (one, two)
    return found


def embeds(files: Sequence[bytes], seconds: float) -> float:
    """Files embedded in a second."""
    began, count = time.perf_counter(), 0
    while time.perf_counter() < began + seconds:
        embed_file(files[count % len(files)], "ply", Limits(), DEFAULT)
        count += 1
    return count / (time.perf_counter() - began)


def matches(records: Sequence[bytes], seconds: float) -> float:
    """Shapes matched with one in a second."""
    rows = [match_record(embedding_from_bytes(record), DEFAULT) for record in records]
    began, count = time.perf_counter(), 0
    while time.perf_counter() < began + seconds:
        score_match_records(rows[0], rows, DEFAULT)
        count += len(rows)
    return count / (time.perf_counter() - began)
