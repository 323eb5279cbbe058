"""The choice of the active pipeline when a service starts."""

from service.observability.logging import get_logger
from service.pipelines import repository
from service.pipelines.active import Pipelines, fingerprint
from service.storage.database import Database
from service.storage.hnsw import ensure_hnsw

log = get_logger("pipelines")


def begin(pipelines: Pipelines, database: Database, *, in_memory: bool = True) -> None:
    """Adopt the active pipeline of the archive, and log a warning if the settings name another one.

    The HNSW index of signatures is built if it is missing or has other parameters. With `in_memory`, the
    signatures are read into memory.

    Raises
    ------
    PipelineUnavailableError
        This version of the service does not have the active pipeline.
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
    log.info("the active pipeline of the archive", extra={"fields": fields})
    if pending is not None:
        log.warning(
            "pipeline %s (%s) is active, not %s (%s) of the settings. %s",
            parameters.name,
            active_pipeline.fingerprint,
            pending.name,
            pending.fingerprint,
            pending.message,
        )
    if embedded < files:
        log.warning(
            "%d of %d files have no embedding by the active pipeline and are not searched: "
            "`isoshape reembed` computes the missing ones",
            files - embedded,
            files,
        )
