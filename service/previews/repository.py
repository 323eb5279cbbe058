"""The SQL of thumbnails."""

from sqlalchemy import select

from service.storage.checksums import checksum_of, is_whole
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import BlobRow, ThumbnailRow


def thumbnail(session: ReadSession, sha256: str, format: str, size: int, drawing: int) -> bytes | None:
    """The stored thumbnail of a file by one version of the renderer; None for a damaged one."""
    row = session.execute(
        select(ThumbnailRow.data, ThumbnailRow.checksum)
        .join(BlobRow, BlobRow.number == ThumbnailRow.blob_number)
        .where(
            BlobRow.sha256 == sha256,
            ThumbnailRow.format == format,
            ThumbnailRow.size == size,
            ThumbnailRow.drawing == drawing,
        )
    ).one_or_none()
    return row.data if row is not None and is_whole(row.data, row.checksum) else None


def store_thumbnail(
    session: WriteSession, sha256: str, format: str, size: int, drawing: int, data: bytes
) -> None:
    """Store a thumbnail, in place of one by another version; nothing happens if the file was deleted."""
    number = session.scalar(select(BlobRow.number).where(BlobRow.sha256 == sha256))
    if number is not None:
        own = {"blob_number": number, "format": format, "size": size, "drawing": drawing}
        session.merge(ThumbnailRow(**own, data=data, checksum=checksum_of(data)))
