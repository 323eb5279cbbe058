"""The HNSW indexes of signatures in PostgreSQL, built by pgvector (Malkov and Yashunin 2018).

Each pipeline has its own index, because the length of a signature depends on the pipeline. PostgreSQL updates
the index with every write.
"""

from sqlalchemy import Index, MetaData, cast, func, select, text

from service.observability.logging import get_logger
from service.storage.columns import POSTGRESQL, PgVector
from service.storage.database import WriteSession
from service.storage.tables import EmbeddingRow

log = get_logger("storage")


def index_name(fingerprint: str) -> str:
    """The name of a pipeline's HNSW index."""
    return f"signatures_{fingerprint}"


def ensure_hnsw(session: WriteSession, fingerprint: str) -> bool:
    """Build a pipeline's HNSW index unless it exists with the parameters of the session; True if built.

    The length of the vectors comes from a stored signature: without any, and on SQLite, no index is built.
    Other writers wait until the index is complete.
    """
    if session.get_bind().dialect.name != POSTGRESQL:
        return False
    lengths = select(func.vector_dims(EmbeddingRow.signature)).where(EmbeddingRow.fingerprint == fingerprint)
    length = session.scalar(lengths.limit(1))
    if length is None:
        return False
    connection, parameters = session.connection(), session.hnsw
    built_with = connection.execute(
        text("SELECT reloptions FROM pg_class WHERE relname = :name AND relkind = 'i'"),
        {"name": index_name(fingerprint)},
    ).scalar()
    if built_with == [f"m={parameters.m}", f"ef_construction={parameters.ef_construction}"]:
        return False
    log.info("building the HNSW index of signatures", extra={"fields": {"fingerprint": fingerprint}})
    # A copy of the table definition: the index of one archive must not join the metadata of all archives.
    table = EmbeddingRow.metadata.tables[EmbeddingRow.__tablename__].to_metadata(MetaData())
    index = Index(
        index_name(fingerprint),
        cast(table.c.signature, PgVector(length)).label("vector"),
        postgresql_using="hnsw",
        postgresql_ops={"vector": "vector_l2_ops"},
        postgresql_with={"m": parameters.m, "ef_construction": parameters.ef_construction},
        postgresql_where=table.c.fingerprint == fingerprint,
    )
    index.drop(connection, checkfirst=True)
    index.create(connection)
    return True
