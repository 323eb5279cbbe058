"""The SQL of search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select

from service.storage.database import ReadSession
from service.storage.tables import ArchiveRow, BlobRow, EmbeddingRow, RemovalRow, ShapeRow


@dataclass(frozen=True, eq=False)
class Signed:
    """Shapes and their signatures.

    Attributes
    ----------
    shapes : int64, shape (n,)
        Their numbers.
    embeddings : int64, shape (n,)
        The number of each shape's embedding.
    signatures : float32, shape (n, s)
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]


def revision(session: ReadSession) -> int:
    """How many times what is searched has changed."""
    return session.scalars(select(ArchiveRow.revision)).one()


def signed_since(session: ReadSession, fingerprint: str, since: int) -> Signed:
    """The shapes that came, or were embedded, after a revision, as far as one pipeline embedded them."""
    query = (
        select(ShapeRow.number, EmbeddingRow.number, EmbeddingRow.signature)
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .where(ShapeRow.revision > since, EmbeddingRow.fingerprint == fingerprint)
    )
    rows = session.execute(query).all()
    return Signed(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float32) if rows else np.empty((0, 0), np.float32),
    )


def removed_since(session: ReadSession, since: int) -> NDArray[np.int64]:
    """The numbers of the shapes deleted after a revision."""
    query = select(RemovalRow.shape_number).where(RemovalRow.revision > since)
    return np.array(session.scalars(query).all(), dtype=np.int64)


def embedding_records(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
    """The records of embeddings, by number, without those that are gone."""
    query = select(EmbeddingRow.number, EmbeddingRow.record).where(EmbeddingRow.number.in_(numbers))
    return dict(session.execute(query).all())


def numbers_of_bytes(session: ReadSession, sha256: str) -> list[int]:
    """The numbers of the shapes with some bytes."""
    query = select(ShapeRow.number).join(BlobRow, BlobRow.number == ShapeRow.blob_number)
    return list(session.scalars(query.where(BlobRow.sha256 == sha256)))
