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


def index_name(fingerprint: str) -> str:
    """Return the name of a pipeline's HNSW index."""
    return f"signatures_{fingerprint}"


def view_index_name(length: int) -> str:
    """Return the name of the HNSW index of view signatures of a length."""
    return f"view_signatures_{length}"


def has_view_signature(length: int) -> ColumnElement[bool]:
    """Return the condition that an embedding has a view signature of a length."""
    return func.vector_dims(CoarseSamplesRow.view_signature) == literal(length, literal_execute=True)


def ensure_hnsw(session: WriteSession, fingerprint: str) -> bool:
    """Build the HNSW indexes of a pipeline unless they exist with the parameters of the session.

    One is of its signatures. The other is of the view signatures of all pipelines that have views of one
    length. The lengths of the vectors come from stored ones: without any, and on SQLite, no index is built.
    Other writers wait until the indexes are complete.

    Returns
    -------
    bool
        Whether an index was built.
    """
    if session.get_bind().dialect.name != POSTGRESQL:
        return False
    by_pipeline = EmbeddingRow.fingerprint == fingerprint
    lengths = select(func.vector_dims(EmbeddingRow.signature)).where(by_pipeline)
    length = session.scalar(lengths.limit(1))
    if length is None:
        return False
    built = _ensure(
        session, index_name(fingerprint), EmbeddingRow.signature, "vector_l2_ops", length, by_pipeline
    )
    lengths = select(func.vector_dims(CoarseSamplesRow.view_signature)).join(
        EmbeddingRow, EmbeddingRow.number == CoarseSamplesRow.embedding_number
    )
    length = session.scalar(lengths.where(by_pipeline).limit(1))
    if length is None:
        return built
    condition = has_view_signature(length)
    name = view_index_name(length)
    return (
        _ensure(session, name, CoarseSamplesRow.view_signature, "vector_l1_ops", length, condition) or built
    )


def _ensure(
    session: WriteSession,
    name: str,
    column: InstrumentedAttribute[Any],
    operators: str,
    length: int,
    condition: ColumnElement[bool],
) -> bool:
    connection, parameters = session.connection(), session.hnsw
    built_with = connection.execute(
        text("SELECT reloptions FROM pg_class WHERE relname = :name AND relkind = 'i'"), {"name": name}
    ).scalar()
    if built_with == [f"m={parameters.m}", f"ef_construction={parameters.ef_construction}"]:
        return False
    log.info("building an HNSW index", extra={"fields": {"name": name}})
    # A copy of the table definition: the index of one archive must not join the metadata of all archives.
    table = Table.metadata.tables[column.class_.__tablename__].to_metadata(MetaData())
    index = Index(
        name,
        cast(table.c[column.key], PgVector(length)).label("vector"),
        postgresql_using="hnsw",
        postgresql_ops={"vector": operators},
        postgresql_with={"m": parameters.m, "ef_construction": parameters.ef_construction},
        postgresql_where=condition,
    )
    index.drop(connection, checkfirst=True)
    index.create(connection)
    return True
