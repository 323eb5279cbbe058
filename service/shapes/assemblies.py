"""Assemblies: a file in; a shape for the whole, and one for each distinct part, out."""

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime

from starlette.concurrency import run_in_threadpool

from core.errors import MeshError
from core.pipeline import Pipeline
from service.collections import repository as collections_repository
from service.compute.reader_answers import PartFile
from service.compute.tasks import Embedded
from service.container import Container
from service.errors import BadRequestFieldsError, FieldFault, FileTimeLimitError
from service.http.idempotency import repository as idempotency
from service.http.idempotency.keys import Claim, Kept
from service.observability.timings import Timings
from service.shapes import file_repository
from service.shapes.fields import NAME_CHARACTERS, clean_metadata, clean_name
from service.shapes.records import NewShape, StoredAssembly
from service.shapes.schemas import Assembly
from service.shapes.service import answer_to, put_shape
from service.storage.database import Database

ASSEMBLY, PATH, INSTANCES = "assembly", "assembly_path", "instances"
"""Keys of a part's metadata: the name of the whole shape, the names from the root of the assembly to the
first instance of the part, and the number of instances."""

# The format that parts are written in, which states its unit.
_PART_FORMAT = "3mf"
_PATH_CHARACTERS = 1_000

# A file, by its SHA-256 and its format.
_FileKey = tuple[str, str]


class _EmbeddingMissingError(Exception):
    """A file must be embedded first."""


async def ingest_assembly(
    container: Container, new: NewShape, claim: Claim | None = None
) -> StoredAssembly | Kept:
    """Store a file as a shape, and each distinct part of it as a shape of its own, all in one transaction.

    Stages: read the parts; embed the whole and the parts in workers where needed; store all of them with the
    answer to a claim. A part is a 3MF in its own frame, with the tags and the metadata of the whole, and with
    `ASSEMBLY`, `PATH` and `INSTANCES`. A file without parts is one shape.

    Raises
    ------
    BadRequestFieldsError
        The metadata have a key of the parts, or no room for them.
    MeshError
        The file or a part of it cannot be used; the message names the part.
    CollectionNotFoundError
        The collection was deleted.
    IdempotencyKeyReusedError
        The key of the claim was used with another payload.
    """
    timings = Timings()
    if claim is not None:
        kept = await run_in_threadpool(answer_to, container.database, claim)
        if kept is not None:
            return kept
    _check_metadata(new)
    with timings.stage("parts"):
        parts = await container.queue.parts(new.data, new.format)
    shapes = [new, *(_shape_of(new, part, number) for number, part in enumerate(parts, start=1))]
    while True:
        pipeline, needed = await run_in_threadpool(_look_up, container, shapes)
        embedded = await _embed(container, needed, pipeline)
        with timings.stage("store"):
            stored = await run_in_threadpool(
                _store, container.database, pipeline.fingerprint, shapes, embedded, claim
            )
        if stored is not None:
            break
    for stages in (timings.milliseconds, *(embedding.milliseconds for embedding in embedded.values())):
        container.metrics.stages("upload", stages)
    return stored


def answer_of(stored: StoredAssembly) -> Kept:
    """Return the answer to an upload: status 201 if a shape is new, 200 if all of them were there."""
    return Kept(
        status=201 if any(shape.created for shape in (stored.whole, *stored.parts)) else 200,
        location=f"/shapes/{stored.whole.shape.id}",
        body=Assembly.of_stored(stored).model_dump_json(),
    )


def _check_metadata(new: NewShape) -> None:
    """Refuse metadata that have a key of the parts."""
    reserved = sorted({ASSEMBLY, PATH, INSTANCES} & new.metadata.keys())
    if reserved:
        raise BadRequestFieldsError(
            FieldFault("metadata", f"with split=parts, the service sets {', '.join(reserved)}")
        )


def _shape_of(whole: NewShape, part: PartFile, number: int) -> NewShape:
    """Return a part as a new shape, with its assembly before its name."""
    part_name = part.name or f"part {number}"
    path = "/".join(part.path)
    about = {ASSEMBLY: whole.name, PATH: path[-_PATH_CHARACTERS:], INSTANCES: part.instances}
    try:
        metadata = clean_metadata({**whole.metadata, **about})
    except ValueError as error:
        fault = FieldFault("metadata", f"with the metadata of the part {part_name!r}: {error}")
        raise BadRequestFieldsError(fault) from error
    name = clean_name(f"{whole.name[: NAME_CHARACTERS - len(part_name) - 1]}/{part_name}")
    return NewShape(part.data, _PART_FORMAT, whole.collection, name, whole.tags, metadata)


def _look_up(container: Container, shapes: Sequence[NewShape]) -> tuple[Pipeline, list[NewShape]]:
    """Return the active pipeline, and the shapes whose files need an embedding, one for each file."""
    with container.database.read() as session:
        pipeline = container.pipelines.current(session).pipeline
        needed: dict[_FileKey, NewShape] = {}
        for new in shapes:
            if not file_repository.is_embedded(session, pipeline.fingerprint, *_key(new)):
                needed.setdefault(_key(new), new)
        return pipeline, list(needed.values())


async def _embed(
    container: Container, shapes: Sequence[NewShape], pipeline: Pipeline
) -> dict[_FileKey, Embedded]:
    """Embed files, as many at a time as there are workers; the first error ends all."""
    room = asyncio.Semaphore(container.settings.workers)

    async def embed(new: NewShape) -> Embedded:
        async with room:
            try:
                return await container.queue.embed(new.data, new.format, pipeline)
            except (FileTimeLimitError, MeshError) as error:
                if ASSEMBLY not in new.metadata:
                    raise
                raise type(error)(f"{new.name}: {error}") from error

    try:
        async with asyncio.TaskGroup() as group:
            tasks = {_key(new): group.create_task(embed(new)) for new in shapes}
    except ExceptionGroup as failed:
        raise failed.exceptions[0] from None
    return {key: task.result() for key, task in tasks.items()}


def _store(
    database: Database,
    fingerprint: str,
    shapes: Sequence[NewShape],
    embedded: dict[_FileKey, Embedded],
    claim: Claim | None,
) -> StoredAssembly | Kept | None:
    """Store the whole and its parts in one transaction; None, and nothing stored, if a file must be embedded.

    That happens as in `service.shapes.service`.
    """
    try:
        with database.write() as session:
            collections_repository.require(session, shapes[0].collection)
            now = datetime.now(UTC)
            kept = None if claim is None else idempotency.answer_to(session, claim, now)
            if kept is not None:
                return kept
            stored = []
            for new in shapes:
                shape = put_shape(session, fingerprint, new, embedded.get(_key(new)))
                if shape is None:
                    raise _EmbeddingMissingError
                stored.append(shape)
            assembly = StoredAssembly(stored[0], tuple(stored[1:]))
            if claim is not None:
                idempotency.keep(session, claim, answer_of(assembly), now)
            return assembly
    except _EmbeddingMissingError:
        return None


def _key(new: NewShape) -> _FileKey:
    return new.sha256, new.format
