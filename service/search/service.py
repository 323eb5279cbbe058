"""The search for the most similar stored shapes, and the comparison of two."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats
from core.descriptors.registry import descriptors_of
from core.embedding import Embedding, Match, Scores
from core.mesh.mesh import Mesh
from core.ranking.shortlist import spectral_distances
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.compute.request_queue import RequestQueue, short_of_memory
from service.container import Container
from service.errors import NotEmbeddedError
from service.index.density_samples import CollectionSample
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.class_probability import class_scores_of, probabilities
from service.search.compared_shapes import ComparedShape
from service.search.descriptors import collection_sample
from service.search.likeness import relation_of, relations_of, stored_mesh
from service.search.ranking import Compared, ranked
from service.search.records import Answer, Comparison, Options, Query, Relation, SearchResult
from service.search.scoring import compare_with
from service.search.shortlist import Candidates, candidates
from service.shapes import file_repository, file_service
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeRecord, StoredEmbedding, sha256

Done = TypeVar("Done")


async def in_one_pipeline(container: Container, work: Callable[[ActivePipeline], Awaitable[Done]]) -> Done:
    """The result of work with the active pipeline, done again if the archive changed its pipeline meanwhile.

    The embeddings that the work began with may have been deleted.
    """

    def current() -> ActivePipeline:
        with container.database.read() as session:
            return container.pipelines.current(session)

    active_pipeline = await run_in_threadpool(current)
    while True:
        try:
            done = await work(active_pipeline)
        except NotEmbeddedError:
            before, active_pipeline = active_pipeline, await run_in_threadpool(current)
            if active_pipeline is before:
                raise
        else:
            before, active_pipeline = active_pipeline, await run_in_threadpool(current)
            if active_pipeline is before:
                return done


async def by_file(
    container: Container,
    collection: CollectionNumber,
    data: bytes,
    format: str,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Query:
    """The query by a file; the shapes of the collection with the same bytes are the query itself."""
    embedded = await container.queue.embed(data, format, active_pipeline.pipeline)
    timings.milliseconds |= embedded.milliseconds

    def itself() -> frozenset[int]:
        with container.database.read() as session:
            return frozenset(repository.numbers_of_bytes(session, collection, sha256(data)))

    return Query(
        active_pipeline,
        embedded.record,
        await run_in_threadpool(itself),
        lambda: container.queue.read(data, format),
    )


async def by_id(
    container: Container,
    collection: CollectionNumber,
    shape_id: str,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Query:
    """The query by a stored shape of a collection."""
    fingerprint = active_pipeline.fingerprint

    def read() -> Query:
        with container.database.read() as session:
            stored = file_service.get_stored_embedding(session, fingerprint, collection, shape_id)
            return Query(active_pipeline, stored.record, frozenset([stored.shape]), mesh, stored.number)

    async def mesh() -> Mesh:
        return await stored_mesh(container, collection, shape_id)

    with timings.stage("read"):
        return await run_in_threadpool(read)


async def search(container: Container, query: Query, options: Options, timings: Timings) -> Answer:
    """The stored shapes most like the query."""
    with timings.stage("shortlist"):
        chosen = await run_in_threadpool(candidates, container, query, options)
    container.metrics.query_compared.observe(len(chosen.shapes))
    with timings.stage("compare"):
        compared, scored = await compare_with(container, query, chosen, options.rank_by)
    with timings.stage("results"):
        best = ranked(compared, options.rank_by)
        best = best[compared.cc[best] >= options.min_cc][: options.top_k]
        found = await results(container, query, compared, scored, best, options)
    with timings.stage("likeness"):
        relations = await relations_of(container, query, options.filter.collection, found)
    return Answer(
        pipeline=query.active_pipeline.pipeline,
        found=found,
        relations=relations,
        best_cc=float(compared.cc.max()) if len(compared.cc) else None,
        compared=len(compared.shapes),
        stored=chosen.stored,
        boundary_ratio=query.embedding.facts.boundary_ratio,
        embedding=query.embedding if options.embedding else None,
    )


async def compare(
    container: Container,
    collection: CollectionNumber,
    first: ComparedShape,
    second: ComparedShape,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> tuple[Comparison, Relation]:
    """Two shapes compared, and the relation of the second to the first.

    Their class probability depends on how dense the shapes of the collection are.
    """

    def read() -> CollectionSample:
        with container.database.read() as session:
            return collection_sample(container, session, active_pipeline, collection)

    with timings.stage("read"):
        sample = await run_in_threadpool(read)
    with timings.stage("compare"):
        query = Query(active_pipeline, first.record, frozenset())
        match = await container.queue.match(first.record, second.record, active_pipeline.pipeline)
        other = embedding_from_bytes(second.record)
        combined = await run_in_threadpool(_combined, query, other, match, sample)
        typical_probability = await run_in_threadpool(_combined, query, other, match, None)
        found = Comparison(active_pipeline.pipeline, query.embedding, other, match, combined)
    with timings.stage("likeness"):
        records, meshes = (first.record, second.record), (first.mesh, second.mesh)
        return found, await relation_of(container, found, typical_probability, records, meshes)


async def results(
    container: Container,
    query: Query,
    compared: Compared,
    scored: Candidates,
    best: NDArray[np.intp],
    options: Options,
) -> list[SearchResult]:
    """The best shapes as they are shown, without one that was deleted a moment ago.

    `scored` are the shapes of `compared`; `best` are places in both.
    """
    fingerprint, collection = query.active_pipeline.fingerprint, options.filter.collection

    def measured() -> tuple[list[tuple[ShapeRecord, StoredEmbedding | None]], Floats, Floats]:
        scores = compared.combined
        scores = class_scores_of(container, query, shown, cc, sim) if scores is None else scores[best]
        typical_scores = class_scores_of(container, query, replace(shown, sample=None, density=None), cc, sim)
        return read(), scores, typical_scores

    def read() -> list[tuple[ShapeRecord, StoredEmbedding | None]]:
        with container.database.read() as session:
            numbers = compared.shapes[best].tolist()
            shapes = shapes_repository.records(session, fingerprint, collection, numbers)
            if not options.correspondences:
                return [(shape, None) for shape in shapes]
            return [
                (shape, file_repository.embedding_of(session, fingerprint, collection, shape.id))
                for shape in shapes
            ]

    shown, cc, sim = scored.only(best), compared.cc[best], compared.sim[best]
    with short_of_memory():
        shapes, scores, typical_scores = await run_in_threadpool(measured)
    spectral = spectral_distances(scored.signature, shown.signatures)
    spectral_of = dict(zip(best.tolist(), spectral.tolist(), strict=True))
    probability_of = dict(zip(best.tolist(), probabilities(scores).tolist(), strict=True))
    typical_of = dict(zip(best.tolist(), probabilities(typical_scores).tolist(), strict=True))
    places = {int(compared.shapes[place]): int(place) for place in best}
    found = []
    for shape, stored in shapes:
        place = places[shape.number]
        probability = probability_of[place]
        found.append(
            SearchResult(
                shape=shape,
                cc=float(compared.cc[place]),
                ssd=float(compared.ssd[place]),
                sim=float(compared.sim[place]),
                combined=probability,
                typical_probability=typical_of[place],
                spectral=spectral_of[place],
                size_ratio=float((shape.facts["area"] / query.embedding.facts.area) ** 0.5),
                comparison=None
                if stored is None
                else await _compared(container.queue, query, stored.record, probability),
            )
        )
    return found


async def _compared(work: RequestQueue, query: Query, record: bytes, combined: float) -> Comparison:
    """The query and the embedding of a record, matched."""
    pipeline = query.active_pipeline.pipeline
    match = await work.match(query.record, record, pipeline)
    return Comparison(pipeline, query.embedding, embedding_from_bytes(record), match, combined)


def _combined(query: Query, other: Embedding, match: Match, sample: CollectionSample | None) -> float:
    """The class probability of two shapes; local densities are those in a collection's sample."""
    pipeline = query.active_pipeline.pipeline
    scores = Scores(*(np.array([score]) for score in (match.cc, match.ssd, match.sim)))
    own = others = None
    if sample is not None:
        own, others = sample.of_query(query.descriptors), sample.of_query(descriptors_of(other))
    return float(pipeline.combined(query.embedding, [other], scores, own, others)[0])
