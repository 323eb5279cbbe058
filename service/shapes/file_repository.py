"""The SQL of files: their bytes, embeddings and thumbnails."""

from collections.abc import Collection
from typing import Any

from sqlalchemy import Row, ScalarSelect, func, select, update

from core.descriptors.pieces import SIZE, number_of_pieces
from core.errors import BadRecordError
from service.collection import CollectionNumber
from service.compute.tasks import Embedded
from service.errors import NotEmbeddedError, ShapeNotFoundError, SignatureLengthError
from service.index.repository import OF_SHAPE
from service.shapes.records import FileKey
from service.storage.checksums import checksum_of, is_whole
from service.storage.database import ReadSession, WriteSession
from service.storage.in_place import stored_bytes
from service.storage.postgresql import ensure_hnsw
from service.storage.tables import (
    NOT_DELETED,
    BlobRow,
    CoarseSamplesRow,
    EmbeddingRow,
    PieceRow,
    ShapeRow,
    ThumbnailRow,
)


def file_of(
    session: ReadSession, collection: CollectionNumber, shape_id: str, *, deleted: bool = False
) -> bytes:
    """Return the uploaded bytes of a shape, or of a deleted one.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    BadRecordError
        The bytes are damaged.
    FileInPlaceError
        The file is in a source, and cannot be read there or has changed.
    """
    row = session.execute(
        select(BlobRow.data, BlobRow.sha256)
        .join(ShapeRow, ShapeRow.blob_number == BlobRow.number)
        .where(ShapeRow.id == shape_id, ShapeRow.collection_number == collection)
        .where(~NOT_DELETED if deleted else NOT_DELETED)
    ).one_or_none()
    if row is None:
        raise ShapeNotFoundError(shape_id)
    return stored_bytes(session, row.data, row.sha256)


def embedding_of(
    session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str
) -> Row[int, str, dict[str, Any], int | None, bytes, str]:
    """Return the embedding of a shape by one pipeline, its own `number` and `record`, with the shape.

    The row has the number of the `shape`, and its `format` and `facts`.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    NotEmbeddedError
        The pipeline has not embedded the shape.
    BadRecordError
        The record does not have its checksum.
    """
    row = session.execute(
        select(
            ShapeRow.number.label("shape"),
            ShapeRow.format,
            ShapeRow.facts,
            EmbeddingRow.number,
            EmbeddingRow.record,
            EmbeddingRow.checksum,
        )
        .select_from(ShapeRow)
        .outerjoin(EmbeddingRow, is_its_embedding(fingerprint))
        .where(ShapeRow.id == shape_id, ShapeRow.collection_number == collection, NOT_DELETED)
    ).one_or_none()
    if row is None:
        raise ShapeNotFoundError(shape_id)
    if row.number is None:
        raise NotEmbeddedError(shape_id)
    if not is_whole(row.record, row.checksum):
        raise BadRecordError(f"embedding {row.number} does not have its checksum")
    return row


def is_embedded(session: ReadSession, fingerprint: str, sha256: str, format: str) -> bool:
    """Return whether a pipeline has embedded some bytes in a format."""
    query = (
        select(EmbeddingRow.number)
        .join(BlobRow, BlobRow.number == EmbeddingRow.blob_number)
        .where(
            BlobRow.sha256 == sha256, EmbeddingRow.format == format, EmbeddingRow.fingerprint == fingerprint
        )
    )
    return session.scalar(query) is not None


def blob_number(session: ReadSession, sha256: str) -> int | None:
    """Return the number of the blob with a SHA-256."""
    return session.scalar(select(BlobRow.number).where(BlobRow.sha256 == sha256))


def add_blob(session: WriteSession, data: bytes, sha256: str, *, in_place: bool = False) -> int:
    """Store a new blob, without its bytes if they stay in a source; its number."""
    kept = None if in_place else data
    return int(session.insert(BlobRow, {"sha256": sha256, "size": len(data), "data": kept}))


def keep_bytes(session: WriteSession, number: int, data: bytes) -> None:
    """Store the bytes of a blob that lacks them."""
    # A comparison of the bytes with NULL would read them.
    lacking = BlobRow.number == number, func.length(BlobRow.data).is_(None)
    session.execute(update(BlobRow).where(*lacking).values(data=data))


def add_embedding(
    session: WriteSession, blob_number: int, format: str, fingerprint: str, embedded: Embedded
) -> None:
    """Store a new embedding. The first one of a pipeline begins its HNSW index.

    Raise SignatureLengthError if its signature is not as long as the pipeline's others, which are searched as
    one matrix.
    """
    latest = session.scalar(
        select(EmbeddingRow.signature)
        .where(EmbeddingRow.fingerprint == fingerprint)
        .order_by(EmbeddingRow.number.desc())
        .limit(1)
    )
    if latest is not None and len(latest) != len(embedded.signature):
        raise SignatureLengthError(
            f"the signature has {len(embedded.signature)} numbers; the stored ones have {len(latest)}"
        )
    number = session.insert(
        EmbeddingRow,
        {
            "blob_number": blob_number,
            "format": format,
            "fingerprint": fingerprint,
            "signature": embedded.signature,
            "record": embedded.record,
            "checksum": checksum_of(embedded.record),
        },
    )
    beside = {
        "data": embedded.coarse_samples,
        "signature": embedded.signature.astype("<f4").tobytes(),
        "view_signature": embedded.view_signature,
        "reliability": embedded.reliability,
        "checksum": checksum_of(embedded.coarse_samples),
    }
    session.insert(CoarseSamplesRow, {"embedding_number": number, **beside})
    of_several = number_of_pieces(embedded.pieces) > 1
    for place, lengths in enumerate(embedded.pieces.astype("<f4")):
        row = {"of_several": of_several, "size": float(lengths[SIZE]), "lengths": lengths.tobytes()}
        session.insert(PieceRow, {"embedding_number": number, "place": place, **row})
    if latest is None:
        ensure_hnsw(session, fingerprint)


def facts_on(session: ReadSession, blob_number: int, format: str) -> dict[str, Any] | None:
    """Return the facts of a blob in a format, if a shape has it."""
    return session.scalar(
        select(ShapeRow.facts).where(ShapeRow.blob_number == blob_number, ShapeRow.format == format).limit(1)
    )


def thumbnails(
    session: ReadSession, files: Collection[FileKey], size: int, drawing: int
) -> dict[FileKey, bytes]:
    """Return those stored thumbnails of files that one version of the renderer drew and that are whole."""
    rows = session.execute(
        select(BlobRow.sha256, ThumbnailRow.format, ThumbnailRow.data, ThumbnailRow.checksum)
        .join(BlobRow, BlobRow.number == ThumbnailRow.blob_number)
        .where(
            BlobRow.sha256.in_({sha256 for sha256, _ in files}),
            ThumbnailRow.size == size,
            ThumbnailRow.drawing == drawing,
        )
    )
    return {(row.sha256, row.format): row.data for row in rows if is_whole(row.data, row.checksum)}


def store_thumbnail(
    session: WriteSession, sha256: str, format: str, size: int, drawing: int, data: bytes
) -> None:
    """Store a thumbnail, in place of one by another version; nothing happens if the file was deleted."""
    number = blob_number(session, sha256)
    if number is not None:
        key = {"blob_number": number, "format": format, "size": size, "drawing": drawing}
        session.merge(ThumbnailRow(**key, data=data, checksum=checksum_of(data)))


def is_its_embedding(fingerprint: str | ScalarSelect[str | None]) -> Any:  # noqa: ANN401
    """Return the condition that an embedding is that of a shape by a pipeline."""
    return OF_SHAPE & (EmbeddingRow.fingerprint == fingerprint)
