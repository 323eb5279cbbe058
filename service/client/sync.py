"""The synchronous client."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import wraps
from itertools import count
from types import TracebackType
from typing import Concatenate, ParamSpec, Self, TypeVar

import httpx

from service.client import collection_calls, job_calls, search_calls, shape_calls
from service.client.calls import (
    NO_ANSWER,
    TIMEOUT,
    Call,
    Step,
    headers_with,
    no_address,
    no_answer,
    signature_of,
)
from service.client.retries import pause

P = ParamSpec("P")
T = TypeVar("T")


def _method(make: Callable[P, Call[T]]) -> Callable[Concatenate["Client", P], T]:
    """A method that sends one call."""

    @wraps(make)
    def method(self: "Client", /, *given: P.args, **options: P.kwargs) -> T:
        return self.send(make(*given, **options))

    method.__dict__["__signature__"] = signature_of(make)
    return method


def _series(make: Callable[P, Call[Step[T]]]) -> Callable[Concatenate["Client", P], Iterator[T]]:
    """A method that sends the calls of a series and iterates over all items."""

    @wraps(make)
    def method(self: "Client", /, *given: P.args, **options: P.kwargs) -> Iterator[T]:
        call: Call[Step[T]] | None = make(*given, **options)
        while call is not None:
            step = self.send(call)
            yield from step.items
            call = step.more
            if call is not None and step.seconds:
                time.sleep(step.seconds)

    method.__dict__["__signature__"] = signature_of(make, Iterator)
    return method


class Client:
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

    Raises
    ------
    ClientError
        A header cannot hold the key or the name of the collection.

    Notes
    -----
    Every method raises `ProblemError`, `UnreachableError` or `UnexpectedAnswerError`. Several threads may use
    a client at the same time.
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
        headers = headers_with(key, collection)
        try:
            self._http = httpx.Client(base_url=url, headers=headers, transport=transport, timeout=timeout)
        except httpx.InvalidURL as error:
            raise no_address(url, error) from error
        self.url = url

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def ready(self) -> bool:
        """Whether the service is ready; false also when it does not answer."""
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
                    raise no_answer(self.url, fault) from fault
                seconds = pause(answer, attempt)
                if seconds is None:
                    break
                time.sleep(seconds)
        return call.read(answer)

    upload = _method(shape_calls.upload)
    page = _method(shape_calls.page)
    shapes = _series(shape_calls.shapes)
    shape = _method(shape_calls.shape)
    file = _method(shape_calls.file)
    embedding = _method(shape_calls.embedding)
    thumbnail = _method(shape_calls.thumbnail)
    preview = _method(shape_calls.preview)
    preview_file = _method(shape_calls.preview_file)
    replace_file = _method(shape_calls.replace_file)
    update = _method(shape_calls.update)
    delete = _method(shape_calls.delete)
    deleted = _series(shape_calls.deleted)
    restore = _method(shape_calls.restore)
    purge = _method(shape_calls.purge)
    send_archive = _method(job_calls.send_archive)
    job = _method(job_calls.job)
    jobs = _series(job_calls.jobs)
    follow_job = _series(job_calls.follow_job)
    job_files = _series(job_calls.job_files)
    cancel_job = _method(job_calls.cancel_job)
    delete_job = _method(job_calls.delete_job)
    query_file = _method(search_calls.query_file)
    similar = _method(search_calls.similar)
    query_shape = _method(search_calls.query_shape)
    compare = _method(search_calls.compare)
    duplicates = _method(search_calls.duplicates)
    similarity_map = _method(search_calls.similarity_map)
    collections = _method(collection_calls.collections)
    create_collection = _method(collection_calls.create_collection)
    delete_collection = _method(collection_calls.delete_collection)
    version = _method(search_calls.version)
