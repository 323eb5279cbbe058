"""The errors of requests."""

from contextlib import suppress

import httpx
from pydantic import ValidationError

from service.errors import ExpectedError
from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX, Problem


class ClientError(ExpectedError):
    """A request failed."""


class UnreachableError(ClientError):
    """No answer: no service listens at the address, or the connection was lost."""


class UnexpectedAnswerError(ClientError):
    """The answer is not from an Isoshape service."""


class ProblemError(ClientError):
    """The service answered with a problem document.

    Attributes
    ----------
    problem : Problem
        The document.
    kind : str
        The last part of its type, such as "shape-not-found" or "no-triangles". Programs may branch on it.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(f"{problem.title}: {problem.detail}")
        self.problem = problem
        self.kind = problem.type.removeprefix(TYPE_PREFIX)


def error_of(answer: httpx.Response) -> ProblemError | UnexpectedAnswerError:
    """The error of an unsuccessful answer."""
    if answer.headers.get("content-type", "").startswith(MEDIA_TYPE):
        with suppress(ValidationError):
            return ProblemError(Problem.model_validate_json(answer.content))
    return UnexpectedAnswerError(
        f"{answer.request.url} answered {answer.status_code}, and not with a problem document"
    )
