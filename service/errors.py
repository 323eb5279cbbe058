"""The errors of the service, and the table of problems with which they are answered."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from core.errors import BadRecordError

CHALLENGE = 'Bearer realm="isoshape"'

REEMBED = "`isoshape reembed` computes the missing embeddings and activates this pipeline."
"""The message about a pipeline that has not embedded all files yet."""


class ExpectedError(Exception):
    """Base of the errors that are no fault of the program; the message is for the person who runs it.

    `status` is the exit status of a command that the error ends: 1, or 2 where the command was called
    wrongly.
    """

    status: ClassVar[int] = 1


class ServiceError(Exception):
    """Base class of the service's errors.

    Attributes
    ----------
    kind : str
        A key of `PROBLEMS`.
    retry_after : int or None
        Seconds, for the header Retry-After.
    challenge : str or None
        The header WWW-Authenticate (RFC 6750).
    """

    kind: str = "internal-error"
    retry_after: int | None = None
    challenge: str | None = None

    def __init_subclass__(cls, kind: str | None = None, retry_after: int | None = None) -> None:
        cls.kind, cls.retry_after = kind or cls.kind, retry_after or cls.retry_after


@dataclass(frozen=True)
class FieldFault:
    """A field of a request and the reason why its value is invalid."""

    field: str
    message: str


_WORDS = {"extra_forbidden": "there is no field or parameter of this name", "missing": "is required"}


def fault_text(error: Mapping[str, Any]) -> str:
    """Return one of pydantic's errors in words of the service."""
    return _WORDS.get(error["type"]) or plain_text(error["msg"])


def plain_text(message: str) -> str:
    """Return a message of pydantic as what a value must be."""
    return re.sub(r"^\w+ should ", "must ", message.removeprefix("Value error, "))


class BadRequestFieldsError(ServiceError, kind="bad-request-fields"):
    """Fields of the request are invalid."""

    def __init__(self, *faults: FieldFault) -> None:
        super().__init__("; ".join(f"{fault.field}: {fault.message}" for fault in faults))
        self.faults = faults


class MissingError(ServiceError):
    """Nothing has the id. The kind of a subclass is the name of the thing and "-not-found"."""

    def __init__(self, id: str) -> None:
        super().__init__(f"there is no {self.kind.removesuffix('-not-found')} {id!r}")


class ShapeNotFoundError(MissingError, kind="shape-not-found"):
    """The collection has no shape with the id."""


class CollectionNotFoundError(ServiceError, kind="collection-not-found"):
    """No collection has the name."""


class CollectionNotEmptyError(ServiceError, kind="collection-not-empty"):
    """The collection cannot be deleted, because it is not empty or is the default one."""


class NameTakenError(ServiceError, kind="name-taken"):
    """Another shape with the same bytes has the name."""


class FileInPlaceError(BadRecordError):
    """A source's file, whose bytes are in its folder alone, cannot be read there or has changed."""

    kind = "file-in-place"


class SourceNotFoundError(MissingError, kind="source-not-found"):
    """The collection has no source with the id."""


class SourceRefusedError(ServiceError, kind="source-refused"):
    """The folder cannot be a source."""


class FileChangedError(ServiceError, kind="file-changed"):
    """The ETag of the shape's file does not match If-Match."""


class NotEmbeddedError(ServiceError, kind="not-embedded"):
    """The shape has no embedding by the active pipeline."""

    def __init__(self, shape_id: str) -> None:
        super().__init__(
            f"shape {shape_id!r} was embedded by another pipeline only; upload its file again, or run "
            "`isoshape reembed`, which computes all missing embeddings"
        )


class UnauthorizedError(ServiceError, kind="unauthorized"):
    """The request has no key, or an unknown one."""

    def __init__(self, message: str, *, wrong: bool = False) -> None:
        super().__init__(message)
        self.challenge = CHALLENGE + (', error="invalid_token"' if wrong else "")


class ForbiddenError(ServiceError, kind="forbidden"):
    """The key does not allow the request."""

    challenge = CHALLENGE + ', error="insufficient_scope"'


class CrossSiteError(ServiceError, kind="cross-site"):
    """A page of another site caused a browser to send the request."""


class MisdirectedRequestError(ServiceError, kind="misdirected-request"):
    """The request names a host that this service is not."""


class RateLimitError(ServiceError, kind="rate-limit"):
    """The key has exceeded its rate limit."""

    def __init__(self, message: str, *, retry_after: int) -> None:
        super().__init__(message)
        self.retry_after = retry_after


class UnsupportedBodyError(ServiceError, kind="unsupported-media-type"):
    """The endpoint does not support the media type of the body."""


class FileTooLargeError(ServiceError, kind="body-too-large"):
    """The file exceeds the size limit."""


class StalledBodyError(ServiceError, kind="request-timeout"):
    """The body of the request stopped arriving."""


class FileTimeLimitError(ServiceError, kind="file-time-limit"):
    """Reading or embedding the file exceeded its time limit."""


class TaskTimeLimitError(ServiceError, kind="time-limit", retry_after=5):
    """A task exceeded its time limit."""


class BusyError(ServiceError, kind="busy", retry_after=2):
    """The queue of waiting requests is full."""


class CompilingError(ServiceError, kind="not-ready", retry_after=5):
    """The kernels are not compiled for this processor yet, so no worker can start."""

    def __init__(self) -> None:
        super().__init__(
            "the kernels are compiled for this processor, once, which takes about a minute on an idle machine"
        )


class WorkerLostError(ServiceError, kind="worker-lost", retry_after=1):
    """The worker process died, or was killed, before it answered."""


class WorkerCrashedError(WorkerLostError):
    """The worker process crashed during the task; it was not killed."""


class ClusterUnavailableError(ServiceError, kind="cluster-unavailable", retry_after=5):
    """The scheduler of the Dask cluster is unreachable, or has no workers."""


class TaskGivenUpError(WorkerLostError):
    """The worker process was killed because no request waited for its answer."""


class ShuttingDownError(ServiceError, kind="shutting-down", retry_after=5):
    """The service stops before it can answer."""


class StorageUnavailableError(ServiceError, kind="storage-unavailable", retry_after=5):
    """The database is unreachable, locked or read-only."""


class StorageFullError(ServiceError, kind="storage-full", retry_after=60):
    """The database or the temporary folder has no space left."""


class PipelineUnavailableError(ServiceError, kind="pipeline-unavailable", retry_after=60):
    """The active pipeline of the archive is unknown to this version of the service."""


class IdempotencyKeyMalformedError(ServiceError, kind="idempotency-key-malformed"):
    """The header Idempotency-Key does not follow its specification (an IETF draft)."""


class IdempotencyKeyReusedError(ServiceError, kind="idempotency-key-reused"):
    """The key was used with another payload."""


class IdempotencyKeyInFlightError(ServiceError, kind="idempotency-key-in-flight"):
    """The first request with the key has no answer yet."""


class SignatureLengthError(ServiceError):
    """The length of a signature differs from that of all other signatures."""


class ArchiveError(ExpectedError):
    """An archive cannot be opened, checked, backed up or restored; the message gives the reason."""


class ArchiveServedError(ArchiveError):
    """Another process serves the archive; the message names it."""


class ArchiveTooNewError(ArchiveError):
    """A newer version of the service wrote the database."""


@dataclass(frozen=True)
class ProblemKind:
    """The HTTP status of a kind of problem, and its title, which never changes."""

    status: int
    title: str


PROBLEMS: dict[str, ProblemKind] = {
    # of the core
    "empty-file": ProblemKind(422, "The file is empty"),
    "unknown-format": ProblemKind(415, "The file's format is not one that is read"),
    "malformed-mesh": ProblemKind(422, "The file is not a mesh of its format"),
    "non-finite-coordinates": ProblemKind(422, "A coordinate is not a finite number"),
    "no-triangles": ProblemKind(422, "The mesh has no faces"),
    "degenerate-mesh": ProblemKind(422, "The mesh has no surface"),
    "cannot-be-embedded": ProblemKind(422, "The method fails on the mesh"),
    "mesh-too-complex": ProblemKind(422, "The mesh is larger than the limits allow"),
    "external-reference": ProblemKind(422, "The file refers to other files"),
    "bad-parameter": ProblemKind(422, "A parameter is out of its range"),
    "incompatible-embeddings": ProblemKind(409, "The shapes were embedded with different pipelines"),
    "bad-record": ProblemKind(500, "A stored embedding cannot be read"),
    "core-error": ProblemKind(500, "The method failed"),
    # of requests
    "bad-request": ProblemKind(400, "The request cannot be read"),
    "idempotency-key-malformed": ProblemKind(400, "The Idempotency-Key is not a string in quotes"),
    "idempotency-key-in-flight": ProblemKind(409, "The first request with the Idempotency-Key is at work"),
    "idempotency-key-reused": ProblemKind(422, "The Idempotency-Key was used for another request"),
    "bad-request-fields": ProblemKind(422, "Fields of the request cannot be used"),
    "unauthorized": ProblemKind(401, "A key of this service is needed"),
    "forbidden": ProblemKind(403, "The key may not do this"),
    "cross-site": ProblemKind(403, "Pages of other sites may not do this"),
    "rate-limit": ProblemKind(429, "The key has made too many requests"),
    "not-found": ProblemKind(404, "There is nothing at this address"),
    "shape-not-found": ProblemKind(404, "There is no such shape"),
    "decision-not-found": ProblemKind(404, "There is no such decision"),
    "merge-not-found": ProblemKind(404, "There is no such merge"),
    "collection-not-found": ProblemKind(404, "There is no such collection"),
    "method-not-allowed": ProblemKind(405, "The address does not answer this method"),
    "request-timeout": ProblemKind(408, "The request stopped arriving"),
    "name-taken": ProblemKind(409, "The name is taken"),
    "collection-not-empty": ProblemKind(409, "The collection is not empty"),
    "not-embedded": ProblemKind(409, "The shape has no embedding of the pipeline in use"),
    "file-changed": ProblemKind(412, "The file is another by now"),
    "body-too-large": ProblemKind(413, "The upload is too large"),
    "misdirected-request": ProblemKind(421, "The service does not answer under this name"),
    "unsupported-media-type": ProblemKind(415, "The body's media type is not one that is read"),
    "file-time-limit": ProblemKind(422, "The file takes too long to work on"),
    # of archives and their members
    "job-not-found": ProblemKind(404, "There is no such job"),
    "unknown-archive": ProblemKind(415, "The file is not an archive that is read"),
    "malformed-archive": ProblemKind(422, "The archive cannot be read to its end"),
    "archive-too-large": ProblemKind(422, "The archive holds more than the limits allow"),
    "nested-archive": ProblemKind(422, "The file is an archive inside of an archive"),
    "member-damaged": ProblemKind(422, "The file cannot be unpacked"),
    "member-encrypted": ProblemKind(422, "The file is encrypted"),
    "member-kind": ProblemKind(422, "The archive's entry is not a plain file, packed in a way that is read"),
    "member-name": ProblemKind(422, "The file's name in the archive cannot be used"),
    "member-repeated": ProblemKind(422, "The archive has an earlier file of this name"),
    "member-too-large": ProblemKind(422, "The file in the archive is larger than the limits allow"),
    # of folders that stay where they are
    "source-not-found": ProblemKind(404, "There is no such source"),
    "source-refused": ProblemKind(422, "The folder cannot be a source"),
    "file-in-place": ProblemKind(409, "The file is not in its folder as it was read"),
    "file-unreadable": ProblemKind(422, "The file cannot be read in its folder"),
    # of the service
    "internal-error": ProblemKind(500, "The service failed"),
    "busy": ProblemKind(503, "The service is busy"),
    "time-limit": ProblemKind(503, "The work took too long"),
    "worker-lost": ProblemKind(503, "A worker was lost"),
    "cluster-unavailable": ProblemKind(503, "The cluster of workers is not available"),
    "shutting-down": ProblemKind(503, "The service is shutting down"),
    "not-ready": ProblemKind(503, "The service is not ready"),
    "pipeline-unavailable": ProblemKind(503, "The archive is embedded by a pipeline that is not known"),
    "storage-unavailable": ProblemKind(503, "The database is not available"),
    "storage-full": ProblemKind(507, "There is no room left"),
}

BY_STATUS = {
    400: "bad-request",
    404: "not-found",
    405: "method-not-allowed",
    413: "body-too-large",
    415: "unsupported-media-type",
}
