"""The spin images of stored shapes, and the probability that a shape is of the query's class."""

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
from service.search.batches import by_embedding, by_threads
from service.search.records import Query
from service.search.shortlist import Candidates

SPIN_IMAGE_BATCH = 64
"""Shapes whose spin images a thread compares at a time."""


def stored_spin_images(container: Container, embeddings: Sequence[int]) -> dict[int, Bytes]:
    """The spin images of embeddings by number, cached; deleted embeddings and those without are left out."""
    found = container.spin_images.get(embeddings)
    missing = [number for number in embeddings if number not in found]
    if missing:
        with container.database.read() as session:
            records = repository.embedding_records(session, missing)
        for number, record in records.items():
            try:
                spin_images = spin_images_from_bytes(record)
            except BadRecordError:
                continue
            if spin_images.size:
                found[number] = spin_images
                container.spin_images.put(number, spin_images)
    return found


async def class_probabilities(
    container: Container,
    query: Query,
    candidates: Candidates,
    cc: NDArray[np.float64],
    sim: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The class probability of c candidates by their scores: shape (c,), 0 for one deleted meanwhile."""
    pipeline, own = query.active_pipeline.pipeline, query.spin_images
    signatures = candidates.signatures
    if not own.size:
        return pipeline.combined(cc, sim, candidates.signature, signatures)

    def distances(embeddings: NDArray[np.int64]) -> NDArray[np.float64]:
        numbers = embeddings.tolist()
        spin_images = stored_spin_images(container, numbers)
        present = [place for place, number in enumerate(numbers) if number in spin_images]
        found = descriptor_distance(own, [spin_images[numbers[place]] for place in present])
        distances_and_parts = np.full((2, len(numbers)), np.inf)
        distances_and_parts[0, present], distances_and_parts[1, present] = found.distance, found.part
        return distances_and_parts

    distance, part = await by_embedding(
        container, candidates, SPIN_IMAGE_BATCH, 2, by_threads(container, distances)
    )
    return await run_in_threadpool(
        pipeline.combined,
        cc,
        sim,
        candidates.signature,
        signatures,
        DescriptorDistance(distance, part == 1.0),
    )
