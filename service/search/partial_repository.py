"""The SQL of queries with a part."""

from sqlalchemy import select

from service.storage.database import ReadSession
from service.storage.tables import BlobRow, EmbeddingRow


def file_of(session: ReadSession, embedding: int) -> tuple[bytes, str] | None:
    """The bytes that an embedding was made of, and their format."""
    row = session.execute(
        select(BlobRow.data, EmbeddingRow.format)
        .join(EmbeddingRow, EmbeddingRow.blob_number == BlobRow.number)
        .where(EmbeddingRow.number == embedding)
    ).first()
    return None if row is None else (row.data, row.format)
