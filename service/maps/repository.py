"""The SQL of maps."""

from dataclasses import dataclass

import numpy as np
from sqlalchemy import select

from core.arrays import Ints
from core.ranking.coarse_differences import CoarseDescriptors
from service.index.repository import stacked, stacked_views
from service.storage.database import ReadSession
from service.storage.tables import EmbeddingRow, ShapeRow, SketchRow


@dataclass(frozen=True, eq=False)
class MapShapes:
    """Shapes of a map, by number.

    Attributes
    ----------
    ids, names : list of str, length n
    embeddings : int64, shape (n,)
    descriptors : CoarseDescriptors
    """

    ids: list[str]
    names: list[str]
    embeddings: Ints
    descriptors: CoarseDescriptors


def map_shapes(session: ReadSession, fingerprint: str, numbers: Ints) -> MapShapes:
    """The shapes with some numbers that a pipeline has embedded."""
    query = (
        select(
            ShapeRow.id,
            ShapeRow.name,
            EmbeddingRow.number,
            SketchRow.signature,
            SketchRow.view_signature,
            SketchRow.reliability,
        )
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .join(SketchRow, SketchRow.embedding_number == EmbeddingRow.number)
        .where(ShapeRow.number.in_(numbers.tolist()), EmbeddingRow.fingerprint == fingerprint)
        .order_by(ShapeRow.number)
    )
    rows = session.execute(query).all()
    ids, names, embeddings, signatures, views, reliabilities = zip(*rows, strict=True) if rows else [()] * 6
    return MapShapes(
        list(ids),
        list(names),
        np.array(embeddings, dtype=np.int64),
        CoarseDescriptors(
            stacked(signatures).view("<f4"),
            stacked_views(views),
            np.array(reliabilities, dtype=np.float32),
        ),
    )
