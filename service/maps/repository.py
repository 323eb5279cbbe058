"""The SQL of maps."""

from dataclasses import dataclass

from sqlalchemy import select

from core.arrays import Float32s, Ints
from service.index.repository import stacked
from service.storage.database import ReadSession
from service.storage.tables import NOT_DELETED, CoarseSamplesRow, EmbeddingRow, ShapeRow


@dataclass(frozen=True, eq=False)
class MapShapes:
    """Shapes of a map, by number.

    Attributes
    ----------
    ids, names : list of str, length n
    signatures : float32, shape (n, s)
    """

    ids: list[str]
    names: list[str]
    signatures: Float32s


def map_shapes(session: ReadSession, fingerprint: str, numbers: Ints) -> MapShapes:
    """Return the shapes with some numbers that a pipeline has embedded."""
    query = (
        select(ShapeRow.id, ShapeRow.name, CoarseSamplesRow.signature)
        .join(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number) & (EmbeddingRow.format == ShapeRow.format),
        )
        .join(CoarseSamplesRow, CoarseSamplesRow.embedding_number == EmbeddingRow.number)
        .where(ShapeRow.number.in_(numbers.tolist()), NOT_DELETED, EmbeddingRow.fingerprint == fingerprint)
        .order_by(ShapeRow.number)
    )
    rows = session.execute(query).all()
    ids, names, signatures = zip(*rows, strict=True) if rows else ([], [], [])
    return MapShapes(list(ids), list(names), stacked(signatures).view("<f4"))
