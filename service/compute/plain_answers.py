"""Answers of processes that are not trusted: bytes of a fixed form, which nothing unpickles."""

import json
from typing import Any

from core import errors
from core.errors import CoreError

BYTES, VALUE, ERROR = b"B", b"V", b"E"
JSON_BYTES = 64 * 1024
"""The most bytes of an answer that is JSON."""
TEXT = JSON_BYTES // 16
"""The most characters of an error's message, and of its note; JSON may take six bytes for each."""

# Errors by name: those of the core, and those that a task may raise besides.
_ERRORS: dict[str, type[Exception]] = {
    each.__name__: each
    for each in (
        *(each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, CoreError)),
        *(MemoryError, OSError, PermissionError, TypeError, ValueError),
    )
}


class AnswerFormError(Exception):
    """The bytes are not an answer."""


def encode(result: object) -> bytes:
    """The answer with a result: bytes, or a value of JSON."""
    return BYTES + result if isinstance(result, bytes) else VALUE + json.dumps(result).encode()


def encode_error(error: Exception, note: str) -> bytes:
    """The answer with an error: the name of its class, its message and a note."""
    return ERROR + json.dumps([type(error).__name__, str(error)[:TEXT], note[-TEXT:]]).encode()


def decode(answer: bytes) -> Any:  # noqa: ANN401
    """The result of an answer, or raise its error; a `RuntimeError` for a class that is not known here.

    Raises
    ------
    AnswerFormError
        The bytes are not an answer.
    """
    form, content = answer[:1], answer[1:]
    if form == BYTES:
        return content
    if len(answer) > JSON_BYTES:
        raise AnswerFormError(f"the answer has {len(answer)} bytes")
    try:
        value = json.loads(content)
        if form == ERROR:
            name, message, note = map(str, value)
    except (ValueError, TypeError, RecursionError) as error:
        raise AnswerFormError("the answer is not JSON of its form") from error
    if form == ERROR:
        failure = _ERRORS[name](message) if name in _ERRORS else RuntimeError(f"{name}: {message}")
        failure.add_note(note)
        raise failure
    if form != VALUE:
        raise AnswerFormError("the answer has no known form")
    return value
