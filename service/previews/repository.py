"""The SQL of thumbnails."""

from sqlalchemy import select

from service.storage.database import ReadSession, WriteSession
from service.storage.tables import BlobRow, ThumbnailRow


def thumbnail(session: ReadSession, sha256: str, format: str, size: int, drawing: int) -> bytes | None:
    """The stored picture of a file, if there is one of this way of drawing."""
    return session.scalar(
        select(ThumbnailRow.data)
        .join(BlobRow, BlobRow.number == ThumbnailRow.blob_number)
        .where(
            BlobRow.sha256 == sha256,
            ThumbnailRow.format == format,
            ThumbnailRow.size == size,
            ThumbnailRow.drawing == drawing,
        )
    )


def keep_thumbnail(
    session: WriteSession, sha256: str, format: str, size: int, drawing: int, data: bytes
) -> None:
    """Store a picture, in place of one drawn another way; nothing if the file has gone meanwhile."""
    number = session.scalar(select(BlobRow.number).where(BlobRow.sha256 == sha256))
    if number is not None:
        session.merge(ThumbnailRow(blob_number=number, format=format, size=size, drawing=drawing, data=data))
