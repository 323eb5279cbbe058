"""Erasure of shapes, and of the files and embeddings that no other shape has."""

from collections.abc import Collection

from sqlalchemy import ColumnElement, delete, select

from service.storage.database import WriteSession
from service.storage.tables import BlobRow, EmbeddingRow, ShapeRow


def erase(session: WriteSession, condition: ColumnElement[bool]) -> None:
    """Erase the shapes that satisfy a condition, and the files that no other shape has."""
    blobs = set(session.scalars(select(ShapeRow.blob_number).where(condition)))
    session.execute(delete(ShapeRow).where(condition))
    drop_unused(session, blobs)


def drop_unused(session: WriteSession, blobs: Collection[int]) -> None:
    """Erase those of some files that no shape has, and their embeddings in formats that no shape has.

    A deleted shape has its file until it is erased.
    """
    used = select(ShapeRow.number).where(
        ShapeRow.blob_number == EmbeddingRow.blob_number, ShapeRow.format == EmbeddingRow.format
    )
    session.execute(
        delete(EmbeddingRow).where(EmbeddingRow.blob_number.in_(blobs), ~used.exists()),
        execution_options={"synchronize_session": False},
    )
    used = select(ShapeRow.number).where(ShapeRow.blob_number == BlobRow.number)
    session.execute(
        delete(BlobRow).where(BlobRow.number.in_(blobs), ~used.exists()),
        execution_options={"synchronize_session": False},
    )
