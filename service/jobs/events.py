"""The progress of a job as server-sent events (the `text/event-stream` of HTML)."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from starlette.concurrency import run_in_threadpool

from service.collection import CollectionNumber
from service.errors import ServiceError
from service.jobs import service
from service.jobs.schemas import Job
from service.storage.database import Database

MEDIA_TYPE = "text/event-stream"
# The schema of an event in the OpenAPI document.
EVENT: dict[str, Any] = {
    "type": "object",
    "required": ["id", "event", "data"],
    "properties": {
        "id": {"type": "string", "description": "What to send as Last-Event-ID."},
        "event": {"type": "string", "enum": ["progress", "end"]},
        "data": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": {"$ref": "#/components/schemas/Job"},
        },
    },
}
# The server sets this key of the ASGI scope to a function that tells whether the server is stopping.
ENDING_IN_SCOPE = "isoshape.ending"
# The most open streams. Each reads the database twice a second.
FOLLOWERS = 100
LOOK_SECONDS = 0.5
# Proxies and networks close idle connections.
SILENCE_SECONDS = 15.0
RECONNECT_MILLISECONDS = 2000


def read(database: Database, collection: CollectionNumber, job_id: str) -> Job:
    """Return the current state of a job.

    Raises
    ------
    JobNotFoundError
        The collection has no such job.
    """
    with database.read() as session:
        return Job.of(service.progress(session, service.get(session, collection, job_id)))


def name_of(job: Job) -> str:
    """Return the id of an event, which a reconnecting client sends as Last-Event-ID."""
    return f"{job.state}-{job.counts.files - job.counts.waiting}"


async def events(
    database: Database,
    collection: CollectionNumber,
    job: Job,
    followers: set[object],
    ending: Callable[[], bool],
    last: str | None,
) -> AsyncIterator[str]:
    """Yield an event `progress` for each change of a job, and `end` when it has ended.

    `last` is the id of the last event that the client received. When `ending` returns true, the server is
    stopping and the stream ends; browsers then reconnect. `followers` contains the stream while it is open.
    """
    stream = object()
    followers.add(stream)
    try:
        async for text in _events(database, collection, job, ending, last):
            yield text
    finally:
        followers.discard(stream)


async def _events(
    database: Database, collection: CollectionNumber, job: Job, ending: Callable[[], bool], last: str | None
) -> AsyncIterator[str]:
    yield f"retry: {RECONNECT_MILLISECONDS}\n\n"
    last_sent = time.monotonic()
    while True:
        name = name_of(job)
        if job.has_ended or name != last:
            last, last_sent = name, time.monotonic()
            kind = "end" if job.has_ended else "progress"
            yield f"id: {name}\nevent: {kind}\ndata: {job.model_dump_json()}\n\n"
        if job.has_ended or ending():
            return
        if time.monotonic() - last_sent > SILENCE_SECONDS:
            last_sent = time.monotonic()
            yield ": \n\n"
        await asyncio.sleep(LOOK_SECONDS)
        try:
            job = await run_in_threadpool(read, database, collection, job.id)
        except ServiceError:
            # The job was deleted, or the database fails; the next request of the client gets the error.
            return
