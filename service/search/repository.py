"""The SQL of search."""

from collections.abc import Sequence

from sqlalchemy import select

from service.collection import CollectionNumber
from service.storage.database import ReadSession
from service.storage.tables import BlobRow, EmbeddingRow, ShapeRow


def embedding_records(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """The records of embeddings, by number, without those that are gone."""
    query = select(EmbeddingRow.number, EmbeddingRow.record).where(EmbeddingRow.number.in_(numbers))
    return dict(session.execute(query).all())


def numbers_of_bytes(session: ReadSession, collection: CollectionNumber, sha256: str) -> list[int]:
    """The numbers of the collection's shapes with some bytes."""
    query = select(ShapeRow.number).join(BlobRow, BlobRow.number == ShapeRow.blob_number)
    own = ShapeRow.collection_number == collection
    return list(session.scalars(query.where(BlobRow.sha256 == sha256, own)))
