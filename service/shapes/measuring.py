"""Bounding boxes of shapes that an earlier version stored without one, measured from their files."""

import asyncio

from starlette.concurrency import run_in_threadpool

from core.errors import BadRecordError, CoreError
from core.mesh.bounding_box import bounding_box
from core.numerics.guarding import guarded
from service.container import Container
from service.errors import ServiceError
from service.observability.logging import get_logger
from service.pipelines import repository as pipelines_repository
from service.shapes import repository

log = get_logger("shapes")

TRY_AGAIN_SECONDS = 60.0


async def measure_missing(container: Container) -> None:
    """Measure every file without a bounding box, one at a time, while no query runs.

    The task ends when all files that can be read have one.
    """
    unreadable: set[tuple[int, str]] = set()
    while True:
        try:
            files = await run_in_threadpool(_unmeasured, container)
            wanted = [file for file in files if file not in unreadable]
            if not wanted:
                return
            for number, format in wanted:
                await container.searches.until_idle()
                if not await _measure(container, number, format):
                    unreadable.add((number, format))
        except ServiceError as error:
            log.warning("the sizes of stored shapes are measured later: %s", error)
            await asyncio.sleep(TRY_AGAIN_SECONDS)


def _unmeasured(container: Container) -> list[tuple[int, str]]:
    with container.database.read() as session:
        return repository.without_box(session)


async def _measure(container: Container, number: int, format: str) -> bool:
    """Measure a file and store its bounding box; whether that could be done, or the file is gone."""

    def read() -> bytes | None:
        with container.database.read() as session:
            found = pipelines_repository.blob(session, number)
            return None if found is None else found[1]

    def store(box: tuple[float, float, float]) -> None:
        with container.database.write() as session:
            repository.set_box(session, number, format, box)

    try:
        data = await run_in_threadpool(read)
        if data is None:
            return True
        mesh = await container.queue.read(data, format)
        with guarded():
            box = await run_in_threadpool(bounding_box, mesh)
    except (BadRecordError, CoreError) as error:
        log.warning("the size of a stored file cannot be measured: %s", error)
        return False
    await run_in_threadpool(store, box)
    return True
