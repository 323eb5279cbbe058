"""What lies about the points of stored shapes, and the chance that they are of a query's class."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Bytes
from core.descriptors.descriptor_distance import DescriptorDistance, descriptor_distance
from core.errors import BadRecordError
from core.serialization import spin_images_from_bytes
from service.container import Container
from service.search import repository
from service.search.batches import by_threads, each_once
from service.search.records import Query
from service.search.shortlist import Candidates

COMPARED = 64
"""How many shapes a thread compares at a time."""


def stored_spin_images(container: Container, embeddings: Sequence[int]) -> dict[int, Bytes]:
    """The patches of embeddings by number, without those that are gone or have none.

    They are kept in memory from then on.
    """
    found = container.spin_images.rows(embeddings)
    missing = [number for number in embeddings if number not in found]
    if missing:
        with container.database.read() as session:
            records = repository.embedding_records(session, missing)
        for number, record in records.items():
            try:
                rows = spin_images_from_bytes(record)
            except BadRecordError:
                continue
            if rows.size:
                found[number] = rows
                container.spin_images.put(number, rows)
    return found


async def chances(
    container: Container,
    query: Query,
    candidates: Candidates,
    cc: NDArray[np.float64],
    sim: NDArray[np.float64],
) -> NDArray[np.float64]:
    """`combined` of c candidates by their scores: shape (c,), 0 for one that was deleted meanwhile."""
    pipeline, own = query.active_pipeline.pipeline, query.spin_images
    signatures = candidates.signatures
    if not own.size:
        return pipeline.combined(cc, sim, candidates.signature, signatures)

    def compared(embeddings: NDArray[np.int64]) -> NDArray[np.float64]:
        numbers = embeddings.tolist()
        rows = stored_spin_images(container, numbers)
        there = [place for place, number in enumerate(numbers) if number in rows]
        found = descriptor_distance(own, [rows[numbers[place]] for place in there])
        told = np.full((2, len(numbers)), np.inf)
        told[0, there], told[1, there] = found.distance, found.part
        return told

    distance, part = await each_once(container, candidates, COMPARED, 2, by_threads(container, compared))
    return await run_in_threadpool(
        pipeline.combined,
        cc,
        sim,
        candidates.signature,
        signatures,
        DescriptorDistance(distance, part == 1.0),
    )
