"""Tasks of clients in an executor, without processes."""

import asyncio
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any, cast

import pytest

from core.io import DEFAULT_LIMITS
from service.compute import request_queue
from service.compute.pool import LocalPool
from service.compute.request_queue import RequestQueue, end, together
from service.jobs.runner import _changed
from service.turns import Turns, current_client


class Tasks(Executor):
    """An executor of which every task runs until the test ends it."""

    def __init__(self) -> None:
        self.running: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Begin a task."""
        task: Future[Any] = Future()
        task.set_running_or_notify_cancel()
        self.running.append(task)
        return task


class Starting(Executor):
    """An executor whose processes never start."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a task wait."""
        return Future()


def test_the_end_of_a_service_waits_for_no_reader() -> None:
    pool = cast(LocalPool, Starting())
    queue = RequestQueue(pool, pool, DEFAULT_LIMITS, read_seconds=1.0, workers=1)
    with ThreadPoolExecutor(1) as threads:
        reading = threads.submit(queue.zip_directory, b"", 0, 1)
        queue.stop()
        with pytest.raises(CancelledError):
            reading.result(timeout=10)


async def settled() -> None:
    """Let everything happen that is due."""
    for _ in range(10):
        await asyncio.sleep(0)


def begin(turns: Turns, executor: Executor, client: str) -> "asyncio.Task[None]":
    """Ask for a task of a client."""
    current_client.set(client)
    work = request_queue._in_turn(turns, cast(LocalPool, executor), print, client)
    return asyncio.create_task(work)


def test_a_client_has_a_task_beside_those_of_a_flood() -> None:
    async def run() -> None:
        turns, executor = Turns(2), Tasks()
        flood = [begin(turns, executor, "flood") for _ in range(10)]
        other = begin(turns, executor, "other")
        await settled()
        assert len(executor.running) == 3
        executor.running[2].set_result(None)
        await settled()
        assert other.done()
        assert len(executor.running) == 3
        for number in range(10):
            executor.running[number + (number > 1)].set_result(None)
            await settled()
        assert all(each.done() for each in flood)
        assert turns.inside == 0

    asyncio.run(run())


def test_a_cancelled_task_has_its_place_until_its_process_is_free() -> None:
    """Otherwise a client that comes and goes would occupy a process each time."""

    async def run() -> None:
        turns, executor = Turns(1), Tasks()
        given_up = begin(turns, executor, "flood")
        await settled()
        given_up.cancel()
        begin(turns, executor, "flood")
        await settled()
        assert given_up.cancelled()
        assert turns.inside == 2
        assert len(executor.running) == 1
        executor.running[0].set_result(None)
        await settled()
        assert len(executor.running) == 2

    asyncio.run(run())


def test_a_task_that_cannot_begin_leaves_its_place() -> None:
    class Closed(Tasks):
        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            raise RuntimeError

    async def run() -> None:
        turns = Turns(1)
        with pytest.raises(RuntimeError):
            await begin(turns, Closed(), "any")
        assert turns.inside == 0

    asyncio.run(run())


def test_a_cancellation_that_meets_an_error_is_not_lost() -> None:
    """Else what is cancelled once, such as work beside the requests, would go on after its service."""
    begun = asyncio.Event()

    async def fails_when_cancelled() -> None:
        try:
            begun.set()
            await asyncio.Event().wait()
        finally:
            raise ValueError

    async def run() -> None:
        task = asyncio.create_task(together([fails_when_cancelled()]))
        await begun.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(run())


def test_a_cancellation_that_meets_a_change_is_not_lost() -> None:
    async def run() -> None:
        change = asyncio.Event()
        task = asyncio.create_task(_changed(change, 60.0))
        await settled()
        change.set()
        await asyncio.sleep(0)
        if task.cancel():
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(run())


def test_a_task_that_loses_a_cancellation_is_cancelled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_queue, "LOST_SECONDS", 0.01)

    async def loses_one() -> None:
        with suppress(asyncio.CancelledError):
            await asyncio.Event().wait()
        await asyncio.Event().wait()

    async def run() -> None:
        task = asyncio.create_task(loses_one())
        await settled()
        await end(task)
        assert task.cancelled()

    asyncio.run(run())


def test_a_cancellation_of_what_ends_a_task_is_not_lost() -> None:
    """The scanner, which is ended with the service, ends its watch when folders come and go."""
    cleaned = asyncio.Event()

    async def cleans_up() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            await cleaned.wait()

    async def run() -> None:
        ending = asyncio.create_task(end(asyncio.create_task(cleans_up())))
        await settled()
        ending.cancel()
        with pytest.raises(asyncio.CancelledError):
            await ending
        cleaned.set()

    asyncio.run(run())
