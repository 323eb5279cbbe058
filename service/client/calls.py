"""Requests and the reading of their answers, for the synchronous and the asynchronous client."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, get_args, get_type_hints
from urllib.parse import quote

import httpx
from pydantic import BaseModel, JsonValue, ValidationError

from service.client.errors import ClientError, UnexpectedAnswerError, UnreachableError
from service.collection import is_name
from service.shapes.fields import plain_values

File = str | Path | tuple[str, bytes]
"""A mesh to send: its path, or its name (with the ending of its format) and its bytes."""

Conditions = Mapping[str, JsonValue] | Sequence[str]
"""Metadata that shapes must have: keys with their values, or texts of the form key=value."""

T = TypeVar("T")
U = TypeVar("U")
Model = TypeVar("Model", bound=BaseModel)
APage = TypeVar("APage", bound="Page")

COLLECTION = "Isoshape-Collection"
"""The header that names the collection of a call."""

# The most items on one page.
LONGEST_PAGE = 500
# A large mesh may wait for a worker, and its embedding may take minutes.
TIMEOUT = httpx.Timeout(600.0, connect=10.0)
# The errors that httpx raises without an answer.
NO_ANSWER = (httpx.TransportError, httpx.UnsupportedProtocol)


@dataclass(frozen=True)
class Call(Generic[T]):
    """A request and the function that reads its answer.

    Attributes
    ----------
    method, path : str
    read : callable
        Takes a successful answer; its result is returned.
    params, data, headers : dict
        The parameters of the address, the fields of the form and the headers.
    json : object
        The JSON body, if any.
    file : File, optional
        The file of the form.
    files : dict
        Files of the form by the names of other fields.
    streamed : bool
        Whether the file is sent in pieces, because it may be too large for memory.
    """

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    params: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, str | list[str]] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: object = None
    file: File | None = None
    files: Mapping[str, File] = field(default_factory=dict)
    streamed: bool = False

    def prepared(self, stack: ExitStack) -> dict[str, Any]:
        """The arguments of an httpx request; the stack closes the files that this opens.

        Raises
        ------
        OSError
            The file cannot be read.
        """
        given: dict[str, Any] = {"headers": dict(self.headers)}
        # A body without a file is no form, and an address given no parameters keeps its own.
        given |= {"params": self.params} if self.params else {}
        given |= {"json": self.json} if self.json is not None else {}
        if isinstance(self.file, tuple):
            given |= {"data": self.data, "files": {"file": self.file}}
        elif self.file is not None:
            path = Path(self.file)
            content = stack.enter_context(path.open("rb")) if self.streamed else path.read_bytes()
            given |= {"data": self.data, "files": {"file": (path.name, content)}}
        if self.files:
            parts = {name: _part(file) for name, file in self.files.items()}
            given |= {"data": self.data, "files": parts}
        return given

    def then(self, change: Callable[[T], U]) -> "Call[U]":
        """The same request, with another function applied to its result."""
        return Call(**{**vars(self), "read": lambda answer: change(self.read(answer))})


@dataclass(frozen=True)
class Step(Generic[T]):
    """Some items of a series, and the call for more of them, to be sent after `seconds` seconds."""

    items: Sequence[T]
    more: "Call[Step[T]] | None"
    seconds: float = 0.0


class Page(Protocol):
    """A page of items, and the cursor of the next page."""

    @property
    def next_cursor(self) -> str | None:
        """None on the last page."""


def pages(one: Callable[[str | None], Call[APage]], items: Callable[[APage], Sequence[T]]) -> Call[Step[T]]:
    """The items of all pages, from the call of a page by its cursor."""

    def after(cursor: str | None) -> Call[Step[T]]:
        return one(cursor).then(step)

    def step(page: APage) -> Step[T]:
        return Step(items(page), None if page.next_cursor is None else after(page.next_cursor))

    return after(None)


def _part(file: File) -> tuple[str, bytes]:
    """The name and the bytes of a file."""
    if isinstance(file, tuple):
        return file
    path = Path(file)
    return path.name, path.read_bytes()


def parsed(model: type[Model]) -> Callable[[httpx.Response], Model]:
    """A function that reads answers of a model."""

    def read(answer: httpx.Response) -> Model:
        try:
            return model.model_validate_json(answer.content)
        except ValidationError as error:
            raise UnexpectedAnswerError(f"{answer.request.url} gave no {model.__name__}") from error

    return read


def content(answer: httpx.Response) -> bytes:
    """The bytes of the body."""
    return answer.content


def nothing(_answer: httpx.Response) -> None:
    """None, for an answer without a body."""


def segment(shape_id: str) -> str:
    """An id as one segment of an address, with every reserved character quoted."""
    return quote(shape_id, safe="")


def given(**values: object) -> dict[str, Any]:
    """The values that are not None, by name."""
    return {name: value for name, value in values.items() if value is not None}


def conditions(metadata: Conditions) -> list[str]:
    """Conditions on metadata in the form key=value, which the service compares with the stored values.

    Parameters
    ----------
    metadata : mapping or sequence of str
        Keys with the values that shapes were uploaded with, or conditions that are already written.

    Raises
    ------
    ClientError
        A key has an equals sign, or a value is a list or an object; no filter can name these.
    """
    if not isinstance(metadata, Mapping):
        return list(metadata)
    values = plain_values(dict(metadata))
    for key in metadata:
        if "=" in key or key not in values:
            raise ClientError(f"no filter can name the metadata {key!r}: {metadata[key]!r}")
    return [f"{key}={value}" for key, value in values.items()]


def headers_with(key: str | None, collection: str | None) -> dict[str, str]:
    """The headers with a key and the name of a collection.

    Raises
    ------
    ClientError
        A header cannot hold the key, or no collection can have the name.
    """
    key = (key or "").strip()
    if not (key.isascii() and key.isprintable()):
        raise ClientError("the key holds characters that no key has")
    if collection is not None and not is_name(collection):
        raise ClientError(f"no collection can have the name {collection!r}")
    named = {} if collection is None else {COLLECTION: collection}
    return {"Authorization": f"Bearer {key}", **named} if key else named


def no_address(url: str, error: Exception) -> UnreachableError:
    """The error for an invalid address."""
    return UnreachableError(f"{url!r} is not an address: {error}")


def no_answer(url: str, fault: Exception) -> UnreachableError:
    """The error for an address without an answer."""
    return UnreachableError(f"no answer from {url}: {fault}")


def signature_of(make: Callable[..., object], origin: Any = None) -> inspect.Signature:  # noqa: ANN401
    """The signature of a client's method: the arguments of a function that makes a call, and the result.

    Parameters
    ----------
    make : callable
        Annotated to return a `Call`.
    origin : generic type, optional
        The type of a series of items, such as `Iterator`.
    """
    (read,) = get_args(get_type_hints(make)["return"])
    signature = inspect.signature(make)
    this = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return signature.replace(
        parameters=[this, *signature.parameters.values()],
        return_annotation=read if origin is None else origin[get_args(read)],
    )
