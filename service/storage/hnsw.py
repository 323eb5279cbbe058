"""The HNSW indexes of signatures in PostgreSQL, built by pgvector (Malkov and Yashunin 2018).

Each pipeline has its own index, because the length of a signature depends on the pipeline. PostgreSQL updates
the indexes with every write.
"""

from typing import Any

from sqlalchemy import ColumnElement, Index, MetaData, cast, func, literal, select, text
from sqlalchemy.orm import InstrumentedAttribute

from service.observability.logging import get_logger
from service.storage.columns import POSTGRESQL, PgVector
from service.storage.database import WriteSession
from service.storage.tables import CoarseSamplesRow, EmbeddingRow, Table

log = get_logger("storage")

M = 16
"""Neighbours of a signature in each layer, twice as many in the lowest; 2 to 100."""
EF_CONSTRUCTION = 200
"""Size of the candidate list while an index is built; 2 m to 1,000."""
EF_SEARCH = 400
"""Size of the candidate list while an index is searched; 1 to 1,000."""


def index_name(fingerprint: str) -> str:
    """Return the name of a pipeline's HNSW index."""
    return f"signatures_{fingerprint}"


def has_view_signature(length: int) -> ColumnElement[bool]:
    """Return the condition that an embedding has a view signature of a length."""
    return func.vector_dims(CoarseSamplesRow.view_signature) == literal(length, literal_execute=True)


def ensure_hnsw(
    session: WriteSession, fingerprint: str, *, m: int = M, ef_construction: int = EF_CONSTRUCTION
) -> bool:
    """Build a pipeline's HNSW indexes unless they exist with these parameters; return whether one was built.

    One is of its signatures. The other is of the view signatures of all pipelines that have views of one
    length. The lengths of the vectors come from stored ones: without any, and on SQLite, no index is built.
    Other writers wait until the indexes are complete.
    """
    if session.get_bind().dialect.name != POSTGRESQL:
        return False
    parameters = {"m": m, "ef_construction": ef_construction}
    by_pipeline = EmbeddingRow.fingerprint == fingerprint
    length = session.scalar(select(func.vector_dims(EmbeddingRow.signature)).where(by_pipeline).limit(1))
    if length is None:
        return False
    name, column = index_name(fingerprint), EmbeddingRow.signature
    built = _ensure(session, name, column, "vector_l2_ops", length, by_pipeline, parameters)
    views = CoarseSamplesRow.view_signature
    lengths = select(func.vector_dims(views)).join(
        EmbeddingRow, EmbeddingRow.number == CoarseSamplesRow.embedding_number
    )
    length = session.scalar(lengths.where(by_pipeline).limit(1))
    if length is None:
        return built
    name, condition = f"view_signatures_{length}", has_view_signature(length)
    return _ensure(session, name, views, "vector_l1_ops", length, condition, parameters) or built


def _ensure(
    session: WriteSession,
    name: str,
    column: InstrumentedAttribute[Any],
    operators: str,
    length: int,
    condition: ColumnElement[bool],
    parameters: dict[str, int],
) -> bool:
    connection = session.connection()
    built_with = connection.execute(
        text("SELECT reloptions FROM pg_class WHERE relname = :name AND relkind = 'i'"), {"name": name}
    ).scalar()
    if built_with == [f"{parameter}={value}" for parameter, value in parameters.items()]:
        return False
    log.info("building an HNSW index", extra={"fields": {"name": name}})
    # A copy of the table definition: the index of one archive must not join the metadata of all archives.
    table = Table.metadata.tables[column.class_.__tablename__].to_metadata(MetaData())
    index = Index(
        name,
        cast(table.c[column.key], PgVector(length)).label("vector"),
        postgresql_using="hnsw",
        postgresql_ops={"vector": operators},
        postgresql_with=parameters,
        postgresql_where=condition,
    )
    index.drop(connection, checkfirst=True)
    index.create(connection)
    return True
