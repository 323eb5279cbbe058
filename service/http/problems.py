"""Errors as RFC 9457 problem documents: the handlers, and their part of the OpenAPI document."""

from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import Match
from starlette.types import Receive, Scope, Send

from core.errors import CoreError
from service.errors import BY_STATUS, PROBLEMS, BadRequestFieldsError, FieldFault, ServiceError
from service.http.problem_document import MEDIA_TYPE, Problem, faults_of
from service.observability.logging import get_logger, request_id
from service.observability.metrics import METHODS

KIND_IN_SCOPE = "isoshape.problem"

# The kinds of problem that operations answer, for the OpenAPI document; those of bodies, all that have one.
WORKER_PROBLEMS = (
    *("busy", "not-ready", "shutting-down", "worker-lost", "cluster-unavailable", "file-time-limit"),
)
BODY_PROBLEMS = (
    *("bad-request", "bad-request-fields", "body-too-large", "request-timeout", "busy", "storage-full"),
)
FILE_PROBLEMS = (
    *("bad-request-fields", "unsupported-media-type", "unknown-format"),
    *("empty-file", "malformed-mesh", "non-finite-coordinates", "no-triangles", "degenerate-mesh"),
    *("cannot-be-embedded", "mesh-too-complex", "external-reference"),
    *WORKER_PROBLEMS,
)
EXPORT_PROBLEMS = ("mesh-too-complex", "non-finite-coordinates", *WORKER_PROBLEMS)
READ_PROBLEMS = ("bad-request-fields", "storage-unavailable")
WRITE_PROBLEMS = (*READ_PROBLEMS, "storage-full")

IDEMPOTENCY_PROBLEMS = ("idempotency-key-malformed", "idempotency-key-reused", "idempotency-key-in-flight")

log = get_logger("problems")


class ProblemResponse(JSONResponse):
    """A problem document. It leaves its kind in the scope of the request, for the log and the metrics."""

    media_type = MEDIA_TYPE

    def __init__(self, problem: Problem, kind: str, headers: dict[str, str]) -> None:
        super().__init__(problem.model_dump(exclude_none=True), problem.status, headers=headers)
        self.kind = kind

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        scope[KIND_IN_SCOPE] = self.kind
        await super().__call__(scope, receive, send)


class RefusedBodyError(HTTPException):
    """A body that is refused while it arrives.

    FastAPI passes an `HTTPException` on while it reads a body; any other error becomes a 400.
    """

    def __init__(self, error: ServiceError) -> None:
        super().__init__(PROBLEMS[error.kind].status, str(error))
        self.error = error


def problem_response(
    kind: str, detail: str, *, faults: Sequence[FieldFault] = (), headers: dict[str, str] | None = None
) -> JSONResponse:
    """Return the problem document of one occurrence."""
    problem = Problem.answering(request_id.get() or "", kind, detail, faults)
    return ProblemResponse(problem, kind, headers or {})


def problem_of(error: ServiceError) -> JSONResponse:
    """Return the problem document of one of the service's errors."""
    faults = error.faults if isinstance(error, BadRequestFieldsError) else ()
    headers = {} if error.challenge is None else {"WWW-Authenticate": error.challenge}
    if error.retry_after is not None:
        headers["Retry-After"] = str(error.retry_after)
    return problem_response(error.kind, str(error), faults=faults, headers=headers)


def handle_problems(app: FastAPI) -> None:
    """Answer every error of the service, the core and the framework with a problem document."""
    for kind in (ServiceError, CoreError, RequestValidationError):
        app.add_exception_handler(kind, _raised_error)
    app.add_exception_handler(HTTPException, _http_error)


def documented(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI `responses` of an endpoint that may answer these kinds of problem."""
    responses: dict[int | str, dict[str, Any]] = {}
    for kind in sorted(kinds, key=lambda kind: (PROBLEMS[kind].status, kind)):
        row = PROBLEMS[kind]
        response = responses.setdefault(
            row.status,
            {
                "description": "",
                "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}, "examples": {}}},
            },
        )
        response["description"] = ", or ".join(filter(None, [response["description"], row.title]))
        response["content"][MEDIA_TYPE]["examples"][kind] = {
            "summary": row.title,
            "value": Problem.answering("7f9c0e1d", kind, row.title).model_dump(exclude_none=True),
        }
        if row.status in {429, 503, 507}:
            response["headers"] = {
                "Retry-After": {
                    "description": "Seconds to wait before trying again.",
                    "schema": {"type": "integer"},
                }
            }
        if row.status == 401:
            response["headers"] = {
                "WWW-Authenticate": {"description": "Bearer (RFC 6750).", "schema": {"type": "string"}}
            }
    return responses


async def _raised_error(_request: Request, error: Exception) -> JSONResponse:
    if isinstance(error, RequestValidationError):
        error = BadRequestFieldsError(*faults_of(error.errors()))
    assert isinstance(error, ServiceError | CoreError)
    if PROBLEMS[error.kind].status == 500:
        log.error("the service failed", exc_info=error)
    return problem_of(error) if isinstance(error, ServiceError) else problem_response(error.kind, str(error))


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if isinstance(error, RefusedBodyError):
        return problem_of(error.error)
    kind = BY_STATUS.get(error.status_code, "internal-error")
    detail = {
        "not-found": f"there is nothing at {request.url.path}",
        "method-not-allowed": f"{request.url.path} does not answer {request.method}",
    }.get(kind, str(error.detail))
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_answered(request))
    return problem_response(kind, detail, headers=headers)


def _answered(request: Request) -> list[str]:
    """Return the methods that a path answers, over all routes; the framework names those of one route."""
    return [
        method
        for method in sorted(METHODS)
        if any(
            route.matches({**request.scope, "method": method})[0] is Match.FULL
            for route in request.app.routes
        )
    ]
