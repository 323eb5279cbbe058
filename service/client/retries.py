"""When a service that is busy for the moment is asked again."""

import httpx

from service.client.errors import ProblemError, error_of

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


def pause(answer: httpx.Response, attempt: int) -> float | None:
    """Seconds to wait before asking again; None after a success.

    Parameters
    ----------
    answer : httpx.Response
    attempt : int
        How often it was asked before.

    Raises
    ------
    ProblemError, UnexpectedAnswerError
        Asking again is no use, or was tried often enough.
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
    """As long as the service asks, and twice as long each time, so that many clients spread out."""
    asked = answer.headers.get("retry-after", "")
    first = float(asked) if asked.isdecimal() else 1.0
    return min(first * 2.0**attempt, LONGEST_WAIT_SECONDS)
