"""The SQL of search."""

from collections.abc import Sequence

from sqlalchemy import select

from service.collection import CollectionNumber
from service.index.density_samples import FIRST, PRIME, SAMPLE, SECOND
from service.observability.logging import get_logger
from service.storage.checksums import is_whole
from service.storage.database import ReadSession
from service.storage.tables import NOT_DELETED, BlobRow, EmbeddingRow, QuantisedPointsRow, ShapeRow

log = get_logger("search")


def embedding_records(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """The records of embeddings by number; deleted ones are left out, and damaged ones, which are logged."""
    columns = EmbeddingRow.number, EmbeddingRow.record, EmbeddingRow.checksum
    records = {}
    for row in session.execute(select(*columns).where(EmbeddingRow.number.in_(numbers))):
        if is_whole(row.record, row.checksum):
            records[row.number] = row.record
        else:
            log.error("embedding %d is damaged: it does not have its checksum", row.number)
    return records


def points(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """The points of embeddings by number; deleted ones are left out, and damaged ones, which are logged."""
    columns = QuantisedPointsRow.embedding_number, QuantisedPointsRow.data, QuantisedPointsRow.checksum
    found = {}
    for row in session.execute(select(*columns).where(QuantisedPointsRow.embedding_number.in_(numbers))):
        if is_whole(row.data, row.checksum):
            found[row.embedding_number] = row.data
        else:
            log.error("the points of embedding %d are damaged", row.embedding_number)
    return found


def sampled_embeddings(session: ReadSession, fingerprint: str, collection: CollectionNumber) -> list[int]:
    """The embeddings, by one pipeline, of the shapes of a collection's sample, ascending by shape.

    The same as those of `service.index.density_samples.sampled`.
    """
    short = ShapeRow.number % PRIME
    query = (
        select(ShapeRow.number, EmbeddingRow.number)
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .where(EmbeddingRow.fingerprint == fingerprint, ShapeRow.collection_number == collection, NOT_DELETED)
        .order_by((short * short % PRIME * FIRST + short * SECOND) % PRIME, ShapeRow.number)
        .limit(SAMPLE)
    )
    return [embedding for _, embedding in sorted(session.execute(query).all())]


def numbers_of_bytes(session: ReadSession, collection: CollectionNumber, sha256: str) -> list[int]:
    """The numbers of a collection's shapes with a SHA-256."""
    query = select(ShapeRow.number).join(BlobRow, BlobRow.number == ShapeRow.blob_number)
    own = ShapeRow.collection_number == collection
    return list(session.scalars(query.where(BlobRow.sha256 == sha256, own, NOT_DELETED)))
