"""The graph of a pipeline's signatures by which pgvector finds the nearest (HNSW, Malkov and Yashunin 2018).

There is one a pipeline, since signatures of several have several lengths. It is an index of PostgreSQL: made
with the first signature, kept up by every write, and found by its name.
"""

from sqlalchemy import Index, MetaData, cast, func, select, text

from service.observability.logging import get_logger
from service.storage.columns import POSTGRESQL, PgVector
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import EmbeddingRow

log = get_logger("storage")


def name_of(fingerprint: str) -> str:
    """The name of a pipeline's graph."""
    return f"signatures_{fingerprint}"


def has_graphs(session: ReadSession) -> bool:
    """Whether the database is one that can search by graphs."""
    return session.get_bind().dialect.name == POSTGRESQL


def ensure_hnsw(session: WriteSession, fingerprint: str) -> bool:
    """Make a pipeline's graph, unless it is there with the session's parameters; whether it was made.

    It takes a first signature to know their length: before there is one, nothing is made, nor where there
    are no graphs. Writers wait meanwhile.
    """
    if not has_graphs(session):
        return False
    lengths = select(func.vector_dims(EmbeddingRow.signature)).where(EmbeddingRow.fingerprint == fingerprint)
    length = session.scalar(lengths.limit(1))
    if length is None:
        return False
    connection, parameters = session.connection(), session.graph
    made_with = connection.execute(
        text("SELECT reloptions FROM pg_class WHERE relname = :name AND relkind = 'i'"),
        {"name": name_of(fingerprint)},
    ).scalar()
    if made_with == [f"m={parameters.m}", f"ef_construction={parameters.ef_construction}"]:
        return False
    log.info("the graph of signatures is made", extra={"fields": {"fingerprint": fingerprint}})
    # A table of the same name, so that the index is not taken for one that every archive has.
    table = EmbeddingRow.metadata.tables[EmbeddingRow.__tablename__].to_metadata(MetaData())
    index = Index(
        name_of(fingerprint),
        cast(table.c.signature, PgVector(length)).label("vector"),
        postgresql_using="hnsw",
        postgresql_ops={"vector": "vector_l2_ops"},
        postgresql_with={"m": parameters.m, "ef_construction": parameters.ef_construction},
        postgresql_where=table.c.fingerprint == fingerprint,
    )
    index.drop(connection, checkfirst=True)
    index.create(connection)
    return True
