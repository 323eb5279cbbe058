"""The descriptors of stored shapes, cached, and the samples in which local densities are measured."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Ints
from core.descriptors.registry import ShapeDescriptors
from core.errors import BadRecordError
from core.ranking.local_density import density_sample
from core.serialization import descriptors_from_bytes
from service.collection import CollectionNumber
from service.container import Container
from service.index.density_samples import CollectionSample, sampled
from service.index.repository import revision
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.storage.database import ReadSession


def stored_descriptors(container: Container, embeddings: Sequence[int]) -> dict[int, ShapeDescriptors]:
    """The descriptors of embeddings by number, cached; deleted and unreadable embeddings are left out."""
    found = container.descriptors.get(embeddings)
    missing = [number for number in embeddings if number not in found]
    if missing:
        with container.database.read() as session:
            found |= _read(container, session, missing)
    return found


def collection_sample(
    container: Container,
    session: ReadSession,
    active_pipeline: ActivePipeline,
    collection: CollectionNumber,
) -> CollectionSample:
    """Return the sample of a collection, as the session sees it."""
    fingerprint, now = active_pipeline.fingerprint, revision(session)
    kept = container.density_samples.get(fingerprint, collection)
    if kept is not None and kept[0] == now:
        return kept[1]
    embeddings = _sampled_embeddings(container, session, active_pipeline, collection)
    if kept is not None and np.array_equal(kept[1].embeddings, embeddings):
        sample = kept[1]
    else:
        numbers = embeddings.tolist()
        found = container.descriptors.get(numbers)
        found |= _read(container, session, [number for number in numbers if number not in found])
        shapes = [found[number] for number in numbers if number in found]
        sample = CollectionSample(embeddings, density_sample(shapes))
    container.density_samples.put(fingerprint, collection, now, sample)
    return sample


def _sampled_embeddings(
    container: Container,
    session: ReadSession,
    active_pipeline: ActivePipeline,
    collection: CollectionNumber,
) -> Ints:
    if container.settings.signatures == "database":
        return np.array(repository.sampled_embeddings(session, active_pipeline.fingerprint, collection))
    entries = active_pipeline.index.current(session)
    own = np.flatnonzero(entries.collections == collection)
    return entries.embeddings[own[sampled(entries.shapes[own])]]


def _read(
    container: Container, session: ReadSession, embeddings: Sequence[int]
) -> dict[int, ShapeDescriptors]:
    found = {}
    for number, record in repository.embedding_records(session, embeddings).items():
        try:
            found[number] = descriptors_from_bytes(record)
        except BadRecordError:
            continue
        container.descriptors.put(number, found[number])
    return found
