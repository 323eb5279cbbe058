"""Operations on shapes: store, list, read, change and delete."""

import io
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.embedding import Embedding
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.compute.tasks import Embedded
from service.container import Container
from service.errors import NameTakenError, NotEmbeddedError, ShapeNotFoundError
from service.http.idempotency import repository as idempotency
from service.http.idempotency.records import Claim, Kept
from service.observability.timings import Timings
from service.shapes import repository
from service.shapes.records import (
    Changes,
    NewShape,
    Place,
    RecordPage,
    ShapeFilter,
    ShapeRecord,
    Sort,
    StoredEmbedding,
    StoredShape,
)
from service.shapes.schemas import Shape
from service.shapes.storing import answer_to, put_shape
from service.storage.database import Database, ReadSession, WriteSession


async def ingest(
    container: Container,
    new: NewShape,
    claim: Claim | None = None,
    also: Callable[[WriteSession, StoredShape], object] | None = None,
) -> StoredShape | Kept:
    """Store a file as a shape, unless its collection has a shape with the same bytes, format and name.

    Stages: look up the shape and its embedding; embed the file in a worker if needed; store bytes, shape and
    embedding in one transaction, with the answer to a claim and the changes that `also` makes. When this
    returns, all of them are durable and the next query finds the shape. If the claim already has an answer,
    this returns the answer and stores nothing. If `also` raises, nothing is stored.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    IdempotencyKeyReusedError
        The key of the claim was used with another payload.
    """
    timings = Timings()
    if claim is not None:
        kept = await run_in_threadpool(answer_to, container.database, claim)
        if kept is not None:
            return kept
    while True:
        pipeline, present, needed = await run_in_threadpool(_look_up, container, new)
        if present is not None and not needed and claim is None and also is None:
            return StoredShape(present, created=False)
        embedded = await container.queue.embed(new.data, new.format, pipeline) if needed else None
        with timings.stage("store"):
            stored = await run_in_threadpool(
                _store, container.database, pipeline.fingerprint, new, embedded, claim, also
            )
        if stored is not None:
            break
    made = {} if embedded is None else embedded.milliseconds
    container.metrics.stages("upload", {**made, **timings.milliseconds})
    return stored


def list_page(
    session: ReadSession,
    fingerprint: str,
    shapes: ShapeFilter,
    *,
    after: Place | None,
    limit: int,
    sort: Sort = "oldest",
) -> RecordPage:
    """One page of the shapes that match a filter, in an order."""
    found = repository.page(session, fingerprint, shapes, after=after, limit=limit + 1, sort=sort)
    more = len(found) > limit
    found = found[:limit]
    total = repository.count(session, shapes)
    if not more:
        return RecordPage(found, total, None)
    name = found[-1].name.casefold() if sort == "name" else None
    return RecordPage(found, total, Place(found[-1].number, name))


def get(session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str) -> ShapeRecord:
    """The shape of a collection with an id.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    record = repository.by_id(session, fingerprint, collection, shape_id)
    if record is None:
        raise ShapeNotFoundError(shape_id)
    return record


def get_file(session: ReadSession, collection: CollectionNumber, shape_id: str) -> bytes:
    """The uploaded bytes of a shape.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    data = repository.file_of(session, collection, shape_id)
    if data is None:
        raise ShapeNotFoundError(shape_id)
    return data


def get_stored_embedding(
    session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str
) -> StoredEmbedding:
    """The embedding of a shape, as it is stored.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    NotEmbeddedError
        The active pipeline has not embedded the shape.
    """
    stored = repository.embedding_of(session, fingerprint, collection, shape_id)
    if stored is None:
        get(session, fingerprint, collection, shape_id)
        raise NotEmbeddedError(shape_id)
    return stored


def get_record(session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str) -> bytes:
    """The record of a shape's embedding. It raises the errors of `get_stored_embedding`."""
    return get_stored_embedding(session, fingerprint, collection, shape_id).record


def get_embedding(
    session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str
) -> Embedding:
    """The embedding of a shape. It raises the errors of `get_stored_embedding`."""
    return embedding_from_bytes(get_record(session, fingerprint, collection, shape_id))


def change(
    session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str, changes: Changes
) -> ShapeRecord:
    """Change the name, tags or metadata of a shape.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    NameTakenError
        Another shape of the collection has the new name and the same file.
    """
    record = get(session, fingerprint, collection, shape_id)
    if changes == Changes():
        return record
    if changes.name is not None and repository.is_name_taken(session, collection, record, changes.name):
        raise NameTakenError(f"another shape with the same file has the name {changes.name!r}")
    repository.change(session, record.number, changes)
    return get(session, fingerprint, collection, shape_id)


def remove(session: WriteSession, fingerprint: str, collection: CollectionNumber, shape_id: str) -> None:
    """Delete a shape, and its file and embeddings unless another shape has the same file.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    repository.remove(session, get(session, fingerprint, collection, shape_id))


def as_npz(embedding: Embedding) -> bytes:
    """The arrays of an embedding as a NumPy archive; names of spectral arrays begin with their spectrum's."""
    arrays: dict[str, Any] = {
        "positions": embedding.positions,
        "vertices": embedding.vertices,
        "graph_edges": embedding.graph_edges,
        "graph_lengths": embedding.graph_lengths,
        "tree_edges": embedding.tree_edges,
        "regions": embedding.regions,
        "signature": embedding.signature,
    }
    for spectrum in embedding.spectra:
        arrays[f"{spectrum.name}_eigenvalues"] = spectrum.eigenvalues
        arrays[f"{spectrum.name}_coordinates"] = spectrum.coordinates
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _look_up(container: Container, new: NewShape) -> tuple[Pipeline, ShapeRecord | None, bool]:
    """The active pipeline, the shape if it is already stored, and whether the file needs an embedding."""
    with container.database.read() as session:
        pipeline = container.pipelines.current(session).pipeline
        present = repository.same(session, pipeline.fingerprint, new)
        needed = not repository.is_embedded(session, pipeline.fingerprint, new.sha256, new.format)
        return pipeline, present, needed


def _store(
    database: Database,
    fingerprint: str,
    new: NewShape,
    embedded: Embedded | None,
    claim: Claim | None,
    also: Callable[[WriteSession, StoredShape], object] | None,
) -> StoredShape | Kept | None:
    """Store a new shape in one transaction; None if the file must be embedded first.

    That happens if another pipeline became active, or if the embedding was deleted with its last shape.
    """
    with database.write() as session:
        collections_repository.require(session, new.collection)
        now = datetime.now(UTC)
        # Another process, or a cancelled request, may have stored the answer meanwhile.
        kept = None if claim is None else idempotency.answer_to(session, claim, now)
        if kept is not None:
            return kept
        stored = put_shape(session, fingerprint, new, embedded)
        if stored is None:
            return None
        if claim is not None:
            idempotency.keep(session, claim, answer_of(stored), now)
        if also is not None:
            also(session, stored)
        return stored


def answer_of(stored: StoredShape) -> Kept:
    """The answer to an upload: status 201 for a new shape, 200 for an existing one."""
    return Kept(
        status=201 if stored.created else 200,
        location=f"/shapes/{stored.shape.id}",
        body=Shape.of(stored.shape).model_dump_json(),
    )
