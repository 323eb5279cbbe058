"""Partial queries: the stored shapes that a part may belong to."""

import asyncio
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Bytes
from core.descriptors.descriptor_distance import whole_spin_images
from core.descriptors.partial_matching import part_distances
from core.descriptors.spin_images import KEYPOINTS
from core.errors import BadRecordError, MeshError
from core.parameters import Parameters
from core.ranking.shortlist import least
from service.compute.tasks import part_of_mesh, spin_images_of_mesh
from service.container import Container
from service.errors import FileTimeLimitError
from service.observability.logging import get_logger
from service.observability.timings import Timings
from service.search import repository
from service.search.batches import by_embedding, by_threads
from service.search.class_probability import DESCRIPTOR_BATCH
from service.search.descriptors import stored_descriptors
from service.search.likeness import relations_of
from service.search.records import Answer, Options, Query
from service.search.scoring import compare_with
from service.search.service import results
from service.search.shortlist import Candidates, candidates

log = get_logger("partial")

PART_FACTOR = 2.5
"""Factor of the number of candidates from which a query compares a shortlist: this may miss the whole of a
part, whose signature is another."""


async def search(
    container: Container,
    query: Query,
    options: Options,
    timings: Timings,
) -> Answer:
    """The stored shapes that the query is most likely a part of.

    Stages: choose the candidates; describe the query as a part; rank the candidates by
    `core.descriptors.partial_matching.part_distances` and compare the best; read the results. The record of a
    shape has its spin images. For a record without them, the first query computes them from the file and
    caches them.

    Parameters
    ----------
    container : Container
    query : Query
        Its mesh is read if its record does not describe it as a part.
    options : Options
    timings : Timings
        Receives the time of each stage.
    """
    pipeline = query.active_pipeline.pipeline
    options = replace(options, shortlist_from=math.ceil(PART_FACTOR * options.shortlist_from))
    with timings.stage("shortlist"):
        chosen = await run_in_threadpool(candidates, container, query, options)
    container.metrics.query_compared.observe(len(chosen.shapes))
    with timings.stage("patches"):
        spin_images = query.spin_images[KEYPOINTS:]
        if not len(spin_images) and query.mesh is not None:
            spin_images = await container.queue.do(part_of_mesh, await query.mesh(), pipeline.parameters)
    with timings.stage("compare"):
        distances = await _distances(container, spin_images, chosen, pipeline.parameters)
        finite = np.flatnonzero(np.isfinite(distances))
        distances = distances[finite]
        chosen = replace(chosen.only(finite), reranked=None, finalists=None)
        order = least(distances, chosen.shapes, options.top_k)
        compared, scored = await compare_with(container, query, chosen.only(order), "cc")
    with timings.stage("results"):
        best = np.flatnonzero(compared.cc >= options.min_cc)
        found = await results(container, query, compared, scored, best, options)
    with timings.stage("likeness"):
        relations = await relations_of(container, query, options.filter.collection, found)
    distance_of = dict(zip(chosen.shapes.tolist(), distances.tolist(), strict=True))
    embedding = query.embedding
    return Answer(
        pipeline=pipeline,
        found=[replace(one, part_distance=distance_of[one.shape.number]) for one in found],
        relations=relations,
        best_cc=float(compared.cc.max()) if len(compared.cc) else None,
        compared=len(chosen.shapes),
        stored=chosen.stored,
        boundary_ratio=embedding.facts.openness,
        embedding=embedding if options.embedding else None,
    )


async def _distances(
    container: Container, part: Bytes, candidates: Candidates, parameters: Parameters
) -> NDArray[np.float64]:
    """Distances of a part from c candidates, shape (c,); NaN for deleted and unreadable shapes.

    Shapes without spin images in their record come last: each file is read.
    """

    def by_records(embeddings: NDArray[np.int64]) -> NDArray[np.float64]:
        numbers = embeddings.tolist()
        shapes = stored_descriptors(container, numbers).items()
        rows = {number: shape.spin_images for number, shape in shapes if shape.spin_images.size}
        rows |= container.spin_images.get(numbers)
        known = [index for index, number in enumerate(numbers) if number in rows]
        measured = np.full((1, len(numbers)), np.nan)
        measured[0, known] = part_distances(
            part, [whole_spin_images(rows[numbers[index]]) for index in known]
        )
        return measured

    distances: NDArray[np.float64] = (
        await by_embedding(container, candidates, DESCRIPTOR_BATCH, 1, by_threads(container, by_records))
    )[0]
    slots = asyncio.Semaphore(2 * container.settings.workers)

    async def by_file(number: int) -> None:
        async with slots:
            spin_images = await _spin_images_of_file(container, number, parameters)
            if spin_images is not None:
                container.spin_images.put(number, spin_images)
                (distance,) = await run_in_threadpool(part_distances, part, [whole_spin_images(spin_images)])
                distances[candidates.embeddings == number] = distance

    try:
        async with asyncio.TaskGroup() as group:
            for number in np.unique(candidates.embeddings[np.isnan(distances)]).tolist():
                group.create_task(by_file(number))
    except ExceptionGroup as several:
        raise several.exceptions[0] from None
    return distances


async def _spin_images_of_file(container: Container, embedding: int, parameters: Parameters) -> Bytes | None:
    """The spin images of an embedding's file; None if it was deleted or cannot be read."""

    def read() -> tuple[bytes, str] | None:
        with container.database.read() as session:
            return repository.file_of(session, embedding)

    try:
        file = await run_in_threadpool(read)
        if file is None:
            return None
        return await container.queue.do(spin_images_of_mesh, await container.queue.read(*file), parameters)
    except (BadRecordError, FileTimeLimitError, MeshError) as error:
        log.warning("a stored shape is left out of a partial query: %s", error)
        return None
