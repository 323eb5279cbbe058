"""Partial queries: the stored shapes that a part may belong to."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Bytes
from core.descriptors.partial import part_distances, whole_spin_images
from core.descriptors.spin_images import KEYPOINTS
from core.ranking.shortlist import least
from service.compute.tasks import part_of_mesh
from service.container import Container
from service.observability.timings import Timings
from service.search.batches import by_embedding, by_threads
from service.search.class_probability import DESCRIPTOR_BATCH
from service.search.descriptors import stored_descriptors
from service.search.likeness import relations_of
from service.search.records import Answer, Options, Query
from service.search.scoring import compare_with
from service.search.service import results
from service.search.shortlist import Candidates, candidates

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
    `core.descriptors.partial.part_distances` and compare the best; read the results.

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
    with timings.stage("spin_images"):
        spin_images = query.spin_images[KEYPOINTS:]
        if not len(spin_images) and query.mesh is not None:
            spin_images = await container.queue.do(part_of_mesh, await query.mesh(), pipeline.parameters)
    with timings.stage("compare"):
        distances = await _distances(container, spin_images, chosen)
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
        boundary_ratio=embedding.facts.boundary_ratio,
        embedding=embedding if options.embedding else None,
    )


async def _distances(container: Container, part: Bytes, candidates: Candidates) -> NDArray[np.float64]:
    """Return distances of a part from c candidates, shape (c,); NaN for deleted and unreadable shapes."""

    def by_records(embeddings: NDArray[np.int64]) -> NDArray[np.float64]:
        numbers = embeddings.tolist()
        shapes = stored_descriptors(container, numbers)
        known = [index for index, number in enumerate(numbers) if number in shapes]
        measured = np.full((1, len(numbers)), np.nan)
        measured[0, known] = part_distances(
            part, [whole_spin_images(shapes[numbers[index]].arrays["spin_images"]) for index in known]
        )
        return measured

    measure = by_threads(container, by_records)
    distances = await by_embedding(container, candidates, DESCRIPTOR_BATCH, 1, measure)
    return np.asarray(distances[0])
