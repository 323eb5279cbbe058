"""Requests, the reading of their answers, their errors, and when a request is sent again."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from errno import EILSEQ
from pathlib import Path
from typing import Any, Generic, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, JsonValue, ValidationError

from service.collection import is_name
from service.errors import ExpectedError
from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX, Problem
from service.shapes.fields import plain_values
from service.shapes.schemas import Page

File = str | Path | tuple[str, bytes]
"""A mesh to send: its path, or its name (with the ending of its format) and its bytes."""

Conditions = Mapping[str, JsonValue] | Sequence[str]
"""Metadata that shapes must have: keys with their values, or texts of the form key=value."""

T = TypeVar("T")
U = TypeVar("U")
Model = TypeVar("Model", bound=BaseModel)
PageModel = TypeVar("PageModel", bound=Page)

LONGEST_PAGE = 500
"""The most items on one page."""

COLLECTION = "Isoshape-Collection"
"""The header that names the collection of a call."""

# A large mesh may wait for a worker, and its embedding may take minutes.
TIMEOUT = httpx.Timeout(600.0, connect=10.0)
# The errors that httpx raises without an answer.
NO_ANSWER = (httpx.TransportError, httpx.UnsupportedProtocol)

# The most retries after an answer 429 or 503, by the kind of problem. A file that killed its worker may kill
# another, so it has one retry only. A service is not ready while its kernels are compiled: nine minutes are
# enough on a busy machine.
RETRIES = {
    "busy": 5,
    "rate-limit": 5,
    "not-ready": 20,
    "shutting-down": 3,
    "storage-unavailable": 3,
    "worker-lost": 1,
    "cluster-unavailable": 3,
}
# The same for a proxy, which answers without a problem document.
PROXY_RETRIES = 5
BUSY = frozenset({httpx.codes.TOO_MANY_REQUESTS, httpx.codes.SERVICE_UNAVAILABLE})
LONGEST_WAIT_SECONDS = 30.0


class ClientError(ExpectedError):
    """A request failed."""


class UnreachableError(ClientError):
    """No answer: no service listens at the address, or the connection was lost."""


class UnexpectedAnswerError(ClientError):
    """The answer is not from an Isoshape service."""


class ProblemError(ClientError):
    """The service answered with a `problem` document.

    `kind` is the last part of its type, such as "shape-not-found" or "no-triangles". Programs may branch on
    it.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.text)
        self.problem = problem
        self.kind = problem.type.removeprefix(TYPE_PREFIX)


@dataclass(frozen=True)
class Call(Generic[T]):
    """A request, and the function that reads its successful answer.

    `params` are those of the address, `data` and `files` the fields of a form and its files, each with the
    name of its field, `json` another body. If `streamed`, files are sent in pieces, because they may be too
    large for memory.
    """

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    params: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: object = None
    files: Sequence[tuple[str, File]] = ()
    streamed: bool = False

    def prepared(self, stack: ExitStack) -> dict[str, Any]:
        """Return the arguments of an httpx request; the stack closes the files that this opens.

        Raise OSError if a file cannot be read, or has a name that is not UTF-8.
        """
        # A body without a file is no form, and an address given no parameters keeps its own.
        arguments: dict[str, Any] = {"headers": dict(self.headers)}
        arguments |= {"params": self.params} if self.params else {}
        arguments |= {"json": self.json} if self.json is not None else {}
        if self.files:
            parts = [(name, self._part(file, stack)) for name, file in self.files]
            arguments |= {"data": self.data, "files": parts}
        return arguments

    def _part(self, file: File, stack: ExitStack) -> tuple[str, Any]:
        """Return the name and the content of a file."""
        name = file[0] if isinstance(file, tuple) else Path(file).name
        try:
            name.encode()
        except UnicodeEncodeError:
            raise OSError(EILSEQ, "the name is not UTF-8", name) from None
        if isinstance(file, tuple):
            return file
        path = Path(file)
        return name, stack.enter_context(path.open("rb")) if self.streamed else path.read_bytes()

    def then(self, change: Callable[[T], U]) -> "Call[U]":
        """Return the same request, with another function applied to its result."""
        return replace(self, read=lambda answer: change(self.read(answer)))  # type: ignore[arg-type, return-value]


@dataclass(frozen=True)
class Step(Generic[T]):
    """Some items of a series, and the call for more of them, to be sent after `seconds` seconds."""

    items: Sequence[T]
    more: "Call[Step[T]] | None"
    seconds: float = 0.0


def pages(
    path: str, model: type[PageModel], items: Callable[[PageModel], Sequence[T]], **params: object
) -> Call[Step[T]]:
    """Return the series of the items of all pages at an address, with these parameters."""

    def after(cursor: str | None) -> Call[Step[T]]:
        asked = given(limit=LONGEST_PAGE, cursor=cursor, **params)
        return Call("GET", path, parsed(model), params=asked).then(step)

    def step(page: PageModel) -> Step[T]:
        return Step(items(page), None if page.next_cursor is None else after(page.next_cursor))

    return after(None)


def parsed(model: type[Model]) -> Callable[[httpx.Response], Model]:
    """Return a function that reads answers of a model."""

    def read(answer: httpx.Response) -> Model:
        try:
            return model.model_validate_json(answer.content)
        except ValidationError as error:
            raise UnexpectedAnswerError(f"{answer.request.url} gave no {model.__name__}") from error

    return read


def content(answer: httpx.Response) -> bytes:
    """Return the bytes of the body."""
    return answer.content


def nothing(_answer: httpx.Response) -> None:
    """Return None, for an answer without a body."""


def segment(shape_id: str) -> str:
    """Return an id as one segment of an address, with every reserved character quoted."""
    return quote(shape_id, safe="")


def given(**values: object) -> dict[str, Any]:
    """Return the values that are not None, by name."""
    return {name: value for name, value in values.items() if value is not None}


def conditions(metadata: Conditions) -> list[str]:
    """Return conditions on metadata in the form key=value, which the service compares with stored values.

    Raise ClientError if no filter can name a key with an equals sign, or a value that is a list or an object.
    """
    if not isinstance(metadata, Mapping):
        return list(metadata)
    values = plain_values(dict(metadata))
    for key in metadata:
        if "=" in key or key not in values:
            raise ClientError(f"no filter can name the metadata {key!r}: {metadata[key]!r}")
    return [f"{key}={value}" for key, value in values.items()]


def headers_with(key: str | None, collection: str | None) -> dict[str, str]:
    """Return the headers with a key and the name of a collection.

    Raise ClientError if a header cannot hold the key, or no collection can have the name.
    """
    key = (key or "").strip()
    if not (key.isascii() and key.isprintable()):
        raise ClientError("the key holds characters that no key has")
    if collection is not None and not is_name(collection):
        raise ClientError(f"no collection can have the name {collection!r}")
    named = {} if collection is None else {COLLECTION: collection}
    return {"Authorization": f"Bearer {key}", **named} if key else named


def retry_delay(answer: httpx.Response, attempt: int) -> float | None:
    """Return the seconds of exponential backoff before the next attempt; None after a success.

    The first wait is the one that the service asks for; each later one is twice as long. `attempt` is the
    number of attempts before this one. Raise ProblemError or UnexpectedAnswerError if a retry is of no use.
    """
    if answer.is_success:
        return None
    error = _error_of(answer)
    if isinstance(error, ProblemError):
        retries = RETRIES.get(error.kind, 0)
    else:
        retries = PROXY_RETRIES if answer.status_code in BUSY else 0
    if attempt >= retries:
        raise error
    asked = answer.headers.get("retry-after", "")
    first = float(asked) if asked.isdecimal() else 1.0
    return min(first * 2.0**attempt, LONGEST_WAIT_SECONDS)


def _error_of(answer: httpx.Response) -> ProblemError | UnexpectedAnswerError:
    """Return the error of an unsuccessful answer."""
    if answer.headers.get("content-type", "").startswith(MEDIA_TYPE):
        with suppress(ValidationError):
            return ProblemError(Problem.model_validate_json(answer.content))
    return UnexpectedAnswerError(
        f"{answer.request.url} answered {answer.status_code}, and not with a problem document"
    )
