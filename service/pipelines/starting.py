"""What a service does about pipelines when it starts."""

from service.observability.logging import get_logger
from service.pipelines import repository
from service.pipelines.active import Pipelines, fingerprint
from service.storage.database import Database
from service.storage.hnsw import ensure_hnsw

log = get_logger("pipelines")


def begin(pipelines: Pipelines, database: Database, *, in_memory: bool = True) -> None:
    """Take up the archive's pipeline, and log if it is not the one that was asked for.

    Its signatures are read if they are searched in memory.
    Where the graph of signatures is not there, or was made with other parameters, it is made first.

    Raises
    ------
    PipelineUnavailableError
        This version of the service does not have it.
    """
    with database.write() as session:
        pipelines.begin(session)
        ensure_hnsw(session, fingerprint(session))
    with database.read() as session:
        active_pipeline = pipelines.current(session)
        if in_memory:
            active_pipeline.index.current(session)
        pending = pipelines.pending(session)
        embedded, files = repository.count_embedded(session, active_pipeline.fingerprint)
    parameters = active_pipeline.pipeline.parameters
    fields: dict[str, object] = {"pipeline": parameters.name, "fingerprint": active_pipeline.fingerprint}
    log.info("the archive is searched by this pipeline", extra={"fields": fields})
    if pending is not None:
        log.warning(
            "the archive is searched by pipeline %s (%s), and not by %s (%s), which the settings name, until "
            "`isoshape reembed` has made the embeddings of that one",
            parameters.name,
            active_pipeline.fingerprint,
            pending.name,
            pending.fingerprint,
        )
    if embedded < files:
        log.warning(
            "%d of %d files have no embedding of the pipeline in use, and are not searched: "
            "`isoshape reembed` makes them",
            files - embedded,
            files,
        )
