"""A client of the service's HTTP interface, for Python programs and for the command line.

    from service.client import Client

    with Client("http://127.0.0.1:8000") as archive:
        archive.upload("horse.off", tags=["horse"])
        for result in archive.query_file("another.off", top_k=5).results:
            print(result.rank, result.shape.name, result.cc)

What it returns are the models that the service answers with. It may be used from several threads at a time.
"""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, TypedDict, TypeVar, Unpack
from urllib.parse import quote

import httpx
from pydantic import BaseModel, JsonValue, ValidationError

from service.deleted.schemas import DeletedShape, DeletedShapePage
from service.duplicates.schemas import DuplicatesAnswer
from service.jobs.schemas import Job, JobFile, JobFilePage, JobPage
from service.problems import MEDIA_TYPE, TYPE_PREFIX, Problem
from service.search.ranking import RankBy
from service.search.schemas import CompareAnswer, QueryAnswer
from service.shapes.schemas import Shape, ShapePage
from service.system import Version

File = str | Path | tuple[str, bytes]
"""A mesh to send: its path, or its name (whose ending tells the format) and its bytes."""

Model = TypeVar("Model", bound=BaseModel)

# How often to try again when the service answers 429 or 503, by the kind of problem. A file that killed its
# worker may do so again, so it has one more chance only.
RETRIES = {
    "busy": 5,
    "rate-limit": 5,
    "not-ready": 5,
    "shutting-down": 3,
    "storage-unavailable": 3,
    "worker-lost": 1,
    "cluster-unavailable": 3,
}
# A proxy in front says the same without a problem document.
PROXY_RETRIES = 5
BUSY = frozenset({httpx.codes.TOO_MANY_REQUESTS, httpx.codes.SERVICE_UNAVAILABLE})
LONGEST_WAIT_SECONDS = 30.0
# A large mesh may wait for a worker and then be worked on for minutes.
TIMEOUT = httpx.Timeout(600.0, connect=10.0)


class ClientError(Exception):
    """A request that did not succeed."""


class UnreachableError(ClientError):
    """There is no answer: nothing listens at the address, or the connection was lost."""


class UnexpectedAnswerError(ClientError):
    """The answer is not one of this service."""


class ProblemError(ClientError):
    """The service answered with a problem document.

    Attributes
    ----------
    problem : Problem
        The document.
    kind : str
        The last part of its type, on which a program may branch: "shape-not-found", "no-triangles", ...
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(f"{problem.title}: {problem.detail}")
        self.problem = problem
        self.kind = problem.type.removeprefix(TYPE_PREFIX)


@dataclass(frozen=True)
class Upload:
    """A stored shape, and whether this upload created it or found it there."""

    shape: Shape
    created: bool


class QueryArguments(TypedDict, total=False):
    """How to search; what each is for and its default stand in `service.search.schemas.QueryOptions`."""

    top_k: int
    rank_by: RankBy
    partial: bool
    exhaustive: bool
    tag: Sequence[str]
    name: str
    metadata: Sequence[str]
    filter: Sequence[str]
    exclude: Sequence[str]
    min_cc: float
    scale: Literal["ignore", "respect"]
    exclude_self: bool
    correspondences: bool
    embedding: bool


class Client:
    """The service at an address.

    Parameters
    ----------
    url : str
        For example "http://127.0.0.1:8000".
    key : str, optional
        Where the service asks for one.
    transport : httpx.BaseTransport, optional
        How to get there, instead of the network.
    timeout : httpx.Timeout, optional
        Ten minutes for an answer, unless given.

    Making one raises `ClientError` where the key cannot be sent; every method `ProblemError`,
    `UnreachableError` or `UnexpectedAnswerError`.
    """

    def __init__(
        self,
        url: str,
        *,
        key: str | None = None,
        transport: httpx.BaseTransport | None = None,
        timeout: httpx.Timeout = TIMEOUT,
    ) -> None:
        key = (key or "").strip()
        if not (key.isascii() and key.isprintable()):
            raise ClientError("the key holds characters that no key has")
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        try:
            self._http = httpx.Client(base_url=url, headers=headers, transport=transport, timeout=timeout)
        except httpx.InvalidURL as error:
            raise UnreachableError(f"{url!r} is not an address: {error}") from error
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

    def upload(
        self,
        file: File,
        *,
        name: str | None = None,
        tags: Sequence[str] = (),
        metadata: Mapping[str, JsonValue] | None = None,
    ) -> Upload:
        """Store a mesh. The same bytes under the same name are stored once: then `created` is false."""
        fields: dict[str, str] = {}
        if name is not None:
            fields["name"] = name
        if tags:
            fields["tags"] = ",".join(tags)
        if metadata is not None:
            fields["metadata"] = json.dumps(metadata)
        answer = self._send("POST", "/shapes", data=fields, files={"file": _named_bytes(file)})
        return Upload(_parse(Shape, answer), created=answer.status_code == httpx.codes.CREATED)

    def send_archive(
        self,
        archive: File,
        *,
        tags: Sequence[str] = (),
        metadata: Mapping[str, JsonValue] | None = None,
    ) -> Job:
        """Have every mesh in a zip or tar stored, with tags and metadata, by a job to be followed."""
        fields: dict[str, str] = {"tags": ",".join(tags)} if tags else {}
        if metadata is not None:
            fields["metadata"] = json.dumps(metadata)
        with ExitStack() as stack:
            # Too large to be read at once.
            file = (
                archive
                if isinstance(archive, tuple)
                else (Path(archive).name, stack.enter_context(Path(archive).open("rb")))
            )
            return _parse(Job, self._send("POST", "/jobs", data=fields, files={"file": file}))

    def job(self, job_id: str) -> Job:
        """How far a job is."""
        return _parse(Job, self._send("GET", f"/jobs/{_segment(job_id)}"))

    def follow_job(self, job_id: str, *, seconds: float = 1.0) -> Iterator[Job]:
        """How far a job is, asked every so many seconds until it has ended; that is the last."""
        while True:
            job = self.job(job_id)
            yield job
            if job.has_ended:
                return
            time.sleep(seconds)

    def jobs(self) -> Iterator[Job]:
        """The jobs that have not ended, or ended in the last days, the latest first."""
        cursor: dict[str, str] = {}
        while True:
            page = _parse(JobPage, self._send("GET", "/jobs", params={"limit": 500, **cursor}))
            yield from page.jobs
            if page.next_cursor is None:
                return
            cursor = {"cursor": page.next_cursor}

    def job_files(
        self, job_id: str, *, outcome: Literal["stored", "present", "refused"] | None = None
    ) -> Iterator[JobFile]:
        """What became of each file of a job's archive, in its order; of those with one outcome, or of all."""
        query: dict[str, Any] = {"limit": 500} | ({} if outcome is None else {"outcome": outcome})
        while True:
            page = _parse(JobFilePage, self._send("GET", f"/jobs/{_segment(job_id)}/files", params=query))
            yield from page.files
            if page.next_cursor is None:
                return
            query["cursor"] = page.next_cursor

    def cancel_job(self, job_id: str) -> Job:
        """Store nothing more of a job's archive; what is stored stays."""
        return _parse(Job, self._send("POST", f"/jobs/{_segment(job_id)}/cancel"))

    def delete_job(self, job_id: str) -> None:
        """Cancel a job, and delete its record; what is stored stays."""
        self._send("DELETE", f"/jobs/{_segment(job_id)}")

    def page(
        self,
        *,
        tags: Sequence[str] = (),
        name: str | None = None,
        metadata: Sequence[str] = (),
        limit: int = 50,
        cursor: str | None = None,
    ) -> ShapePage:
        """Some of the stored shapes, oldest first; `metadata` are conditions written key=value."""
        query: dict[str, Any] = {"tag": list(tags), "metadata": list(metadata), "limit": limit}
        query |= {key: value for key, value in (("name", name), ("cursor", cursor)) if value is not None}
        return _parse(ShapePage, self._send("GET", "/shapes", params=query))

    def shapes(
        self, *, tags: Sequence[str] = (), name: str | None = None, metadata: Sequence[str] = ()
    ) -> Iterator[Shape]:
        """All of them, page by page."""
        cursor: str | None = None
        while True:
            page = self.page(tags=tags, name=name, metadata=metadata, limit=500, cursor=cursor)
            yield from page.shapes
            cursor = page.next_cursor
            if cursor is None:
                return

    def shape(self, shape_id: str) -> Shape:
        """One record."""
        return _parse(Shape, self._send("GET", f"/shapes/{_segment(shape_id)}"))

    def file(self, shape_id: str, *, format: str | None = None) -> bytes:
        """The bytes that were uploaded, or the mesh in a format."""
        wanted = {} if format is None else {"format": format}
        return self._send("GET", f"/shapes/{_segment(shape_id)}/file", params=wanted).content

    def replace_file(self, shape_id: str, file: File, *, if_sha256: str | None = None) -> Shape:
        """Have a shape be of another file; where a SHA-256 is given, only if its file has that one now."""
        headers = {} if if_sha256 is None else {"If-Match": f'"{if_sha256}"'}
        path = f"/shapes/{_segment(shape_id)}/file"
        answer = self._send("PUT", path, files={"file": _named_bytes(file)}, headers=headers)
        return _parse(Shape, answer)

    def update(
        self,
        shape_id: str,
        *,
        name: str | None = None,
        tags: Sequence[str] | None = None,
        metadata: Mapping[str, JsonValue] | None = None,
    ) -> Shape:
        """Replace what is given; the rest stays."""
        changes: dict[str, Any] = {
            "name": name,
            "tags": None if tags is None else list(tags),
            "metadata": None if metadata is None else dict(metadata),
        }
        changes = {key: value for key, value in changes.items() if value is not None}
        return _parse(Shape, self._send("PATCH", f"/shapes/{_segment(shape_id)}", json=changes))

    def delete(self, shape_id: str) -> None:
        """Take it out of the archive."""
        self._send("DELETE", f"/shapes/{_segment(shape_id)}")

    def deleted(self) -> Iterator[DeletedShape]:
        """The shapes that can be restored, those deleted first before the others."""
        cursor: dict[str, str] = {}
        while True:
            page = _parse(DeletedShapePage, self._send("GET", "/deleted", params={"limit": 500, **cursor}))
            yield from page.shapes
            if page.next_cursor is None:
                return
            cursor = {"cursor": page.next_cursor}

    def restore(self, shape_id: str) -> Shape:
        """Undo a deletion."""
        return _parse(Shape, self._send("POST", f"/shapes/{_segment(shape_id)}/restore"))

    def purge(self, shape_id: str) -> None:
        """Forget a deleted shape for good."""
        self._send("DELETE", f"/deleted/{_segment(shape_id)}")

    def query_file(self, file: File, **options: Unpack[QueryArguments]) -> QueryAnswer:
        """The stored shapes most like a file."""
        fields = {key: _field(value) for key, value in options.items()}
        answer = self._send("POST", "/query", data=fields, files={"file": _named_bytes(file)})
        return _parse(QueryAnswer, answer)

    def query_shape(self, shape_id: str, **options: Unpack[QueryArguments]) -> QueryAnswer:
        """The stored shapes most like a stored one."""
        body: dict[str, Any] = {"shape_id": shape_id, **options}
        for name in {"exclude", "filter", "metadata", "tag"} & set(body):
            body[name] = list(body[name])
        return _parse(QueryAnswer, self._send("POST", "/query", json=body))

    def compare(self, first: str, second: str) -> CompareAnswer:
        """Two stored shapes point by point, by their ids."""
        return _parse(CompareAnswer, self._send("POST", "/compare", json={"first": first, "second": second}))

    def duplicates(
        self, *, min_cc: float | None = None, max_residual: float | None = None, tag: Sequence[str] = ()
    ) -> DuplicatesAnswer:
        """Groups of near-identical shapes, among those that have every tag."""
        given = {"min_cc": min_cc, "max_residual": max_residual, "tag": list(tag)}
        wanted = {name: value for name, value in given.items() if value is not None}
        return _parse(DuplicatesAnswer, self._send("GET", "/duplicates", params=wanted))

    def version(self) -> Version:
        """Which service this is."""
        return _parse(Version, self._send("GET", "/version"))

    def ready(self) -> bool:
        """Whether it can do its work; false too when there is no answer."""
        try:
            return self._http.get("/readyz").is_success
        except httpx.TransportError:
            return False

    def _send(self, method: str, path: str, **arguments: Any) -> httpx.Response:  # noqa: ANN401
        """The answer if it is a success; a service that is busy for the moment is asked again."""
        attempt = 0
        while True:
            try:
                answer = self._http.request(method, path, **arguments)
            except (httpx.TransportError, httpx.UnsupportedProtocol) as fault:
                raise UnreachableError(f"no answer from {self.url}: {fault}") from fault
            if answer.is_success:
                return answer
            error = _error(answer)
            if isinstance(error, ProblemError):
                retries = RETRIES.get(error.kind, 0)
            else:
                retries = PROXY_RETRIES if answer.status_code in BUSY else 0
            if attempt >= retries:
                raise error
            time.sleep(_wait(answer, attempt))
            attempt += 1


def _parse(model: type[Model], answer: httpx.Response) -> Model:
    try:
        return model.model_validate_json(answer.content)
    except ValidationError as error:
        raise UnexpectedAnswerError(f"{answer.request.url} gave no {model.__name__}") from error


def _error(answer: httpx.Response) -> ProblemError | UnexpectedAnswerError:
    if answer.headers.get("content-type", "").startswith(MEDIA_TYPE):
        with suppress(ValidationError):
            return ProblemError(Problem.model_validate_json(answer.content))
    return UnexpectedAnswerError(
        f"{answer.request.url} answered {answer.status_code}, and not with a problem document"
    )


def _wait(answer: httpx.Response, attempt: int) -> float:
    """Seconds to wait: as the service asks, twice as long each time, so that many clients spread out."""
    asked = answer.headers.get("retry-after", "")
    first = float(asked) if asked.isdecimal() else 1.0
    return min(first * 2.0**attempt, LONGEST_WAIT_SECONDS)


def _named_bytes(file: File) -> tuple[str, bytes]:
    if isinstance(file, tuple):
        return file
    path = Path(file)
    return path.name, path.read_bytes()


def _field(value: object) -> str | list[str]:
    """A query option as a form's field, a list as a field that is repeated."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return list(value)
    return str(value)


def _segment(shape_id: str) -> str:
    """An id as one segment of an address: whatever it holds, it names no other address."""
    return quote(shape_id, safe="")
