"""The progress of a job as server-sent events (the `text/event-stream` of HTML)."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from starlette.concurrency import run_in_threadpool

from service.errors import ServiceError
from service.jobs.schemas import Job

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


def name_of(job: Job) -> str:
    """Return the id of an event, which a reconnecting client sends as Last-Event-ID."""
    return f"{job.state}-{job.counts.files - job.counts.waiting}"


async def events(
    read: Callable[[], Job], job: Job, followers: set[object], ending: Callable[[], bool], last: str | None
) -> AsyncIterator[str]:
    """Yield an event `progress` for each change of a job, and `end` when it has ended.

    `read` returns the current state of the job. `last` is the id of the last event that the client received.
    When `ending` returns true, the server is stopping and the stream ends; browsers then reconnect.
    `followers` contains an object of the stream while it is open.
    """
    stream, last_sent = object(), time.monotonic()
    followers.add(stream)
    try:
        yield f"retry: {RECONNECT_MILLISECONDS}\n\n"
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
            job = await run_in_threadpool(read)
    except ServiceError:
        # The job was deleted, or the database fails; the next request of the client gets the error.
        return
    finally:
        followers.discard(stream)
