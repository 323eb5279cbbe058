"""The loop of a worker process, and the plain form of its answers.

It imports no numerics: it sets numbers of threads before libraries load. Nothing unpickles an answer of plain
form, which processes that are not trusted send.
"""

import json
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from core import errors
from core.errors import CoreError
from service.errors import WorkerCrashedError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
NICENESS = 2
"""Added to the niceness of a worker. With more, queries on the threads of the service would starve the
workers, which queries of others need too."""

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


def serve(connection: "Connection[Any, Any]", *, untrusted: bool = False) -> None:
    """Answer calls, one after another, until the other end of the pipe closes.

    A call is (function, arguments); the answer is (True, result) or (False, error), pickled. Libraries get
    one thread: the pool already has a process for each processor. Answers of an untrusted process have the
    plain form of `encode`; its first call starts the thread of `end_with_parent`, once that thread would be
    confined.
    """
    os.nice(NICENESS)
    for name in THREADS:
        os.environ[name] = "1"
    # An interrupt from the terminal reaches every process of the group; the parent alone handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not untrusted:
        end_with_parent()
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        try:
            result = function(*arguments)
            answer = encode(result) if untrusted else pickle.dumps((True, result))
        except Exception as error:
            answer = encode_error(error, _note()) if untrusted else _failure(error)
        connection.send_bytes(answer)


def end_with_parent() -> None:
    """End this process when its parent ends: nothing else would stop its task."""
    threading.Thread(target=_end_after_parent, daemon=True).start()


def _end_after_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _failure(error: Exception) -> bytes:
    """Return the answer that raises this error at the other end, or its `repr` if it does not pickle."""
    note = _note()
    error.add_note(note)
    try:
        answer = pickle.dumps((False, error))
        pickle.loads(answer)
    except Exception:
        plain = RuntimeError(repr(error))
        plain.add_note(note)
        return pickle.dumps((False, plain))
    return answer


def _note() -> str:
    """Return the traceback of the error that is being handled."""
    return f"in a worker:\n{traceback.format_exc()}"


def encode(result: object) -> bytes:
    """Encode a result without pickle: a byte for its form, then the bytes or the JSON."""
    return BYTES + result if isinstance(result, bytes) else VALUE + json.dumps(result).encode()


def encode_error(error: Exception, note: str) -> bytes:
    """Encode an error without pickle: the name of its class, its message and a note."""
    return ERROR + json.dumps([type(error).__name__, str(error)[:TEXT], note[-TEXT:]]).encode()


def decode(answer: bytes) -> Any:  # noqa: ANN401
    """Return the result of a plain answer, or raise its error; a `RuntimeError` for an unknown class.

    Raise WorkerCrashedError if the bytes are not an answer.
    """
    form, content = answer[:1], answer[1:]
    if form == BYTES:
        return content
    try:
        if form not in {VALUE, ERROR} or len(answer) > JSON_BYTES:
            raise ValueError(f"{len(answer)} bytes of the form {form!r}")
        value = json.loads(content)
        if form == VALUE:
            return value
        name, message, note = map(str, value)
    except (ValueError, TypeError, RecursionError) as error:
        raise WorkerCrashedError("the worker process sent no answer") from error
    failure = _ERRORS[name](message) if name in _ERRORS else RuntimeError(f"{name}: {message}")
    failure.add_note(note)
    raise failure
