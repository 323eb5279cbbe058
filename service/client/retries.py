"""When a request to a busy service is sent again."""

import httpx

from service.client.errors import ProblemError, error_of

# The most retries after an answer 429 or 503, by the kind of problem. A file that killed its worker may kill
# another, so it has one retry only.
RETRIES = {
    "busy": 5,
    "rate-limit": 5,
    "not-ready": 5,
    "shutting-down": 3,
    "storage-unavailable": 3,
    "worker-lost": 1,
    "cluster-unavailable": 3,
}
# The same for a proxy, which answers without a problem document.
PROXY_RETRIES = 5
BUSY = frozenset({httpx.codes.TOO_MANY_REQUESTS, httpx.codes.SERVICE_UNAVAILABLE})
LONGEST_WAIT_SECONDS = 30.0


def pause(answer: httpx.Response, attempt: int) -> float | None:
    """Seconds to wait before the next attempt; None after a success.

    Parameters
    ----------
    answer : httpx.Response
    attempt : int
        The number of attempts before this one.

    Raises
    ------
    ProblemError, UnexpectedAnswerError
        A retry is of no use, or the retries are used up.
    """
    if answer.is_success:
        return None
    error = error_of(answer)
    if isinstance(error, ProblemError):
        retries = RETRIES.get(error.kind, 0)
    else:
        retries = PROXY_RETRIES if answer.status_code in BUSY else 0
    if attempt >= retries:
        raise error
    return _wait(answer, attempt)


def _wait(answer: httpx.Response, attempt: int) -> float:
    """The wait that the service asks for, doubled with each attempt, so that many clients spread out."""
    asked = answer.headers.get("retry-after", "")
    first = float(asked) if asked.isdecimal() else 1.0
    return min(first * 2.0**attempt, LONGEST_WAIT_SECONDS)
