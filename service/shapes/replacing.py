"""Replacement of a shape's file."""

from starlette.concurrency import run_in_threadpool

from core.pipeline import Pipeline
from service.collection import CollectionNumber
from service.compute.tasks import Embedded
from service.container import Container
from service.errors import FileChangedError, NameTakenError
from service.shapes import repository
from service.shapes.files import entity_tag, is_known
from service.shapes.records import NewFile, ShapeRecord
from service.shapes.service import get
from service.shapes.storing import put_file
from service.storage.database import Database


async def replace_file(
    container: Container, collection: CollectionNumber, shape_id: str, file: NewFile, if_match: str | None
) -> ShapeRecord:
    """Replace the file of a shape; its id, name, tags and metadata stay.

    Stages: check the shape and If-Match; embed the file in a worker if needed; replace bytes, embedding and
    shape in one transaction. Every query sees either file, and the shape always has an embedding.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    FileChangedError
        If-Match names another file.
    NameTakenError
        Another shape of the collection has the same name and the new file.
    """
    while True:
        pipeline, needed = await run_in_threadpool(_look_up, container, collection, shape_id, file, if_match)
        embedded = await container.queue.embed(file.data, file.format, pipeline) if needed else None
        replaced = await run_in_threadpool(
            _replace, container.database, pipeline.fingerprint, collection, shape_id, file, embedded, if_match
        )
        if replaced is not None:
            return replaced


def _look_up(
    container: Container, collection: CollectionNumber, shape_id: str, file: NewFile, if_match: str | None
) -> tuple[Pipeline, bool]:
    """The active pipeline, and whether the file needs an embedding."""
    with container.database.read() as session:
        pipeline = container.pipelines.current(session).pipeline
        _check_match(get(session, pipeline.fingerprint, collection, shape_id), if_match)
        return pipeline, not repository.is_embedded(session, pipeline.fingerprint, file.sha256, file.format)


def _replace(
    database: Database,
    fingerprint: str,
    collection: CollectionNumber,
    shape_id: str,
    file: NewFile,
    embedded: Embedded | None,
    if_match: str | None,
) -> ShapeRecord | None:
    """Replace the file in one transaction; None if the file must be embedded first."""
    with database.write() as session:
        record = get(session, fingerprint, collection, shape_id)
        _check_match(record, if_match)
        put = put_file(session, fingerprint, file, embedded)
        if put is None:
            return None
        if (record.sha256, record.format) == (file.sha256, file.format):
            return get(session, fingerprint, collection, shape_id)
        if repository.same(session, fingerprint, collection, file, record.name) is not None:
            raise NameTakenError(f"another shape has this file and the name {record.name!r}")
        repository.replace_file(session, record, file.format, put)
        return get(session, fingerprint, collection, shape_id)


def _check_match(record: ShapeRecord, if_match: str | None) -> None:
    """Raise unless If-Match, if given, matches the stored file."""
    tag = entity_tag(record.sha256)
    if if_match is not None and not is_known(if_match, tag):
        raise FileChangedError(f"the ETag of the file is now {tag}")
