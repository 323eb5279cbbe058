"""The steps that all uploads share: the answer kept for a key, and the rows of a file and of a shape."""

from datetime import UTC, datetime

from service.compute.tasks import Embedded
from service.http.idempotency import repository as idempotency
from service.http.idempotency.records import Claim, Kept
from service.pipelines.active import fingerprint as active_fingerprint
from service.shapes import repository
from service.shapes.records import NewFile, NewShape, StoredFile, StoredShape
from service.storage.database import Database, WriteSession


def answer_to(database: Database, claim: Claim) -> Kept | None:
    """The answer that an earlier request with the key had; None if there was none."""
    with database.read() as session:
        return idempotency.answer_to(session, claim, datetime.now(UTC))


def put_shape(
    session: WriteSession, fingerprint: str, new: NewShape, embedded: Embedded | None
) -> StoredShape | None:
    """Store a new shape, unless it is stored; None if its file has no embedding, as in `put_file`."""
    put = put_file(session, fingerprint, new, embedded)
    if put is None:
        return None
    present = None if put.created else repository.same(session, fingerprint, new.collection, new, new.name)
    if present is not None:
        return StoredShape(present, created=False)
    return StoredShape(repository.add_shape(session, put.blob_number, new, put.facts), created=True)


def put_file(
    session: WriteSession, fingerprint: str, file: NewFile, embedded: Embedded | None
) -> StoredFile | None:
    """Store the bytes and the embedding of a file, unless they are stored.

    None if the file has no embedding: it was deleted after the lookup, or another pipeline became active.
    """
    if active_fingerprint(session) != fingerprint:
        return None
    blob_number = repository.blob_number(session, file.sha256)
    created = blob_number is None
    there = not created and repository.is_embedded(session, fingerprint, file.sha256, file.format)
    if embedded is None and not there:
        return None
    if blob_number is None:
        blob_number = repository.add_blob(session, file.data, file.sha256)
    if embedded is None:
        facts = repository.facts_on(session, blob_number, file.format) or {}
        return StoredFile(blob_number, facts, created)
    if not there:
        repository.add_embedding(session, blob_number, file.format, fingerprint, embedded)
        if not created:
            repository.mark_changed(session, blob_number, file.format, embedded.facts)
    return StoredFile(blob_number, embedded.facts, created)
