"""The loop of a worker process. It imports no numerics: it sets numbers of threads before libraries load."""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from service.compute.plain_answers import encode, encode_error

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
NICENESS = 10
"""Added to the niceness of a worker: queries, on threads of the service, go before embeddings of uploads."""


def serve(connection: "Connection[Any, Any]", *, untrusted: bool = False) -> None:
    """Answer calls, one after another, until the other end of the pipe closes.

    A call is (function, arguments); the answer is (True, result) or (False, error), pickled. Libraries get
    one thread: the pool already has a process for each processor.

    Parameters
    ----------
    connection : Connection
    untrusted : bool
        Whether answers have the form of `service.compute.plain_answers`. The first call then starts the
        thread of `end_with_parent`, once that thread would be confined.
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
    """The answer that raises this error at the other end; its `repr` if the error does not pickle."""
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
    """The traceback of the error that is being handled."""
    return f"in a worker:\n{traceback.format_exc()}"
