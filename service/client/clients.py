"""The two clients, one that waits for each answer and one whose answers are awaited; and many uploads."""

import asyncio
import inspect
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from functools import update_wrapper
from itertools import count
from pathlib import Path
from typing import Any, Generic, Literal, ParamSpec, Self, TypeVar, overload

import httpx

from service.client import calls
from service.client.calls import Upload
from service.client.requests import (
    NO_ANSWER,
    TIMEOUT,
    Call,
    ProblemError,
    Step,
    UnreachableError,
    headers_with,
    retry_delay,
)

P = ParamSpec("P")
T = TypeVar("T")
Waited = TypeVar("Waited")
Awaited = TypeVar("Awaited")


class _Method(Generic[P, Waited, Awaited]):
    """A method of both clients: it makes a call and sends it. Waited is what `Client` returns."""

    def __init__(self, make: Callable[P, Call[Any]], send: str) -> None:
        self._make, self._send = make, send
        self.__doc__ = make.__doc__

    @overload
    def __get__(self, client: None, kind: type) -> Self: ...
    @overload
    def __get__(self, client: "Client", kind: type) -> Callable[P, Waited]: ...
    @overload
    def __get__(self, client: "AsyncClient", kind: type) -> Callable[P, Awaited]: ...
    def __get__(self, client: Any, kind: type) -> Any:
        if client is None:
            return self

        def method(*arguments: P.args, **options: P.kwargs) -> object:
            return getattr(client, self._send)(self._make(*arguments, **options))

        update_wrapper(method, self._make)
        # The function that makes the call returns a call; the method returns its answer.
        signature = inspect.signature(self._make).replace(return_annotation=inspect.Signature.empty)
        method.__dict__["__signature__"] = signature
        return method


def _once(make: Callable[P, Call[T]]) -> _Method[P, T, Coroutine[Any, Any, T]]:
    return _Method(make, "send")


def _series(make: Callable[P, Call[Step[T]]]) -> _Method[P, Iterator[T], AsyncIterator[T]]:
    """Return a method that sends the calls of a series and iterates over all items."""
    return _Method(make, "send_all")


def _opened(
    kind: Callable[..., T], url: str, key: str | None, collection: str | None, **options: object
) -> T:
    """Return a client of httpx; an address that is none is an UnreachableError."""
    try:
        return kind(base_url=url, headers=headers_with(key, collection), **options)
    except httpx.InvalidURL as error:
        raise UnreachableError(f"{url!r} is not an address: {error}") from error


class _Methods:
    """The methods of both clients."""

    upload = _once(calls.upload)
    page = _once(calls.page)
    shapes = _series(calls.shapes)
    facets = _once(calls.facets)
    shape = _once(calls.shape)
    file = _once(calls.file)
    embedding = _once(calls.embedding)
    thumbnail = _once(calls.thumbnail)
    preview = _once(calls.preview)
    preview_file = _once(calls.preview_file)
    replace_file = _once(calls.replace_file)
    update = _once(calls.update)
    update_all = _once(calls.update_all)
    delete = _once(calls.delete)
    deleted = _series(calls.deleted)
    restore = _once(calls.restore)
    purge = _once(calls.purge)
    query_file = _once(calls.query_file)
    similar = _once(calls.similar)
    query_shape = _once(calls.query_shape)
    query_batch = _once(calls.query_batch)
    compare = _once(calls.compare)
    duplicates = _once(calls.duplicates)
    decide = _once(calls.decide)
    decisions = _series(calls.decisions)
    delete_decision = _once(calls.delete_decision)
    merge = _once(calls.merge)
    merges = _series(calls.merges)
    acts = _once(calls.acts)
    undo_merge = _once(calls.undo_merge)
    apply_rule = _once(calls.apply_rule)
    suggestions = _once(calls.suggestions)
    families = _once(calls.families)
    similarity_map = _once(calls.similarity_map)
    send_archive = _once(calls.send_archive)
    job = _once(calls.job)
    jobs = _series(calls.jobs)
    follow_job = _series(calls.follow_job)
    job_files = _series(calls.job_files)
    cancel_job = _once(calls.cancel_job)
    delete_job = _once(calls.delete_job)
    sources = _once(calls.sources)
    add_source = _once(calls.add_source)
    source = _once(calls.source)
    follow_source = _series(calls.follow_source)
    source_files = _series(calls.source_files)
    equal_files = _series(calls.equal_files)
    set_source_rules = _once(calls.set_source_rules)
    rules = _once(calls.rules)
    set_rules = _once(calls.set_rules)
    rescan_source = _once(calls.rescan_source)
    confirm_source = _once(calls.confirm_source)
    remove_source = _once(calls.remove_source)
    collections = _once(calls.collections)
    create_collection = _once(calls.create_collection)
    delete_collection = _once(calls.delete_collection)
    version = _once(calls.version)


class Client(_Methods):
    """A client of the service at an address.

    Parameters
    ----------
    url : str
        For example "http://127.0.0.1:8000".
    key : str, optional
        An API key, where the service asks for one.
    collection : str, optional
        The collection of all calls. Without it the service uses `default`, or the only collection of the key.
    transport : httpx.BaseTransport, optional
        A transport in the place of the network.
    timeout : httpx.Timeout, optional
        Ten minutes for an answer by default.

    Raise ClientError if a header cannot hold the key or the name of the collection. Every method raises
    `ProblemError`, `UnreachableError` or `UnexpectedAnswerError`. Several threads may use a client at a time.
    """

    def __init__(
        self,
        url: str,
        *,
        key: str | None = None,
        collection: str | None = None,
        transport: httpx.BaseTransport | None = None,
        timeout: httpx.Timeout = TIMEOUT,
    ) -> None:
        self.url = url
        self._http = _opened(httpx.Client, url, key, collection, transport=transport, timeout=timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def ready(self) -> bool:
        """Return whether the service is ready; false also when it does not answer."""
        try:
            return self._http.get("/readyz").is_success
        except httpx.TransportError:
            return False

    def send(self, call: Call[T]) -> T:
        """Send a call and read its answer; while the service is busy, send it again."""
        with ExitStack() as stack:
            prepared = call.prepared(stack)
            for attempt in count():
                try:
                    answer = self._http.request(call.method, call.path, **prepared)
                except NO_ANSWER as fault:
                    raise UnreachableError(f"no answer from {self.url}: {fault}") from fault
                seconds = retry_delay(answer, attempt)
                if seconds is None:
                    break
                time.sleep(seconds)
        return call.read(answer)

    def send_all(self, call: Call[Step[T]] | None) -> Iterator[T]:
        """Send the calls of a series, and yield the items."""
        while call is not None:
            step = self.send(call)
            yield from step.items
            call = step.more
            if call is not None and step.seconds:
                time.sleep(step.seconds)


class AsyncClient(_Methods):
    """An asynchronous client, with the parameters, methods and errors of `Client`.

    The methods are awaited; one that gives many items is an asynchronous iterator. Several tasks of one event
    loop may use a client at the same time.
    """

    def __init__(
        self,
        url: str,
        *,
        key: str | None = None,
        collection: str | None = None,
        transport: httpx.AsyncBaseTransport | None = None,
        timeout: httpx.Timeout = TIMEOUT,
    ) -> None:
        self.url = url
        self._http = _opened(httpx.AsyncClient, url, key, collection, transport=transport, timeout=timeout)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def ready(self) -> bool:
        """Return whether the service is ready; false also when it does not answer."""
        try:
            return (await self._http.get("/readyz")).is_success
        except httpx.TransportError:
            return False

    async def send(self, call: Call[T]) -> T:
        """Send a call and read its answer; while the service is busy, send it again."""
        with ExitStack() as stack:
            prepared = await asyncio.to_thread(call.prepared, stack)
            for attempt in count():
                try:
                    answer = await self._http.request(call.method, call.path, **prepared)
                except NO_ANSWER as fault:
                    raise UnreachableError(f"no answer from {self.url}: {fault}") from fault
                seconds = retry_delay(answer, attempt)
                if seconds is None:
                    break
                await asyncio.sleep(seconds)
        return call.read(answer)

    async def send_all(self, call: Call[Step[T]] | None) -> AsyncIterator[T]:
        """Send the calls of a series, and yield the items."""
        while call is not None:
            step = await self.send(call)
            for item in step.items:
                yield item
            call = step.more
            if call is not None and step.seconds:
                await asyncio.sleep(step.seconds)


# Enough to keep the workers of a small machine busy while files are read and sent.
AT_ONCE = 4


@dataclass(frozen=True)
class Item:
    """A mesh to store: the path of its file or its bytes, with its tags and metadata.

    `split` is that of `Client.upload`.
    """

    name: str
    data: bytes | Path
    tags: tuple[str, ...]
    metadata: Mapping[str, str] | None = None
    split: Literal["parts"] | None = None

    @property
    def origin(self) -> str:
        """The name of the mesh in messages."""
        return str(self.data) if isinstance(self.data, Path) else self.name


def upload_all(
    client: Client, items: Sequence[Item], at_once: int = AT_ONCE
) -> Iterator[tuple[Item, Upload | str]]:
    """Yield each item with its upload or the cause of its refusal, in the order in which the uploads end.

    If the service is gone, no further upload begins. Raise ClientError if the service does not answer, or
    gives an unexpected answer.
    """
    pool = ThreadPoolExecutor(at_once)
    try:
        futures: dict[Future[Upload | str], Item] = {
            pool.submit(_upload, client, item): item for item in items
        }
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _upload(client: Client, item: Item) -> Upload | str:
    try:
        data = item.data.read_bytes() if isinstance(item.data, Path) else item.data
        return client.upload((item.name, data), tags=item.tags, metadata=item.metadata, split=item.split)
    except ProblemError as error:
        return f"{error.kind}: {error.problem.detail}"
    except OSError as error:
        return error.strerror or str(error)
