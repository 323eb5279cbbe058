"""The context in which the pipeline computes: one thread, and every fault of arithmetic is an error.

Several threads of linear algebra change the order of sums, and with it the last bits.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from importlib import import_module

import numpy as np
from threadpoolctl import ThreadpoolController

from core.errors import CannotBeEmbeddedError, CoreError


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which the linear algebra of NumPy and SciPy runs on one thread."""
    limited: AbstractContextManager[object] = _controller().limit(limits=1)
    return limited


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the loaded BLAS libraries; the search for them runs once."""
    for name in ("numpy.linalg", "scipy.linalg"):
        import_module(name)
    return ThreadpoolController()


@contextmanager
def guarded() -> Iterator[None]:
    """Yield a context in which linear algebra runs on one thread and arithmetic faults are raised.

    A division by zero, an invalid operation or an overflow in NumPy would otherwise pass as a warning, and
    NaN or infinity would reach a result. Compiled loops are not watched: their results are checked where they
    are used. Raise CannotBeEmbeddedError from any error that is neither a `CoreError` nor a lack of memory.
    """
    try:
        with one_thread(), np.errstate(divide="raise", invalid="raise", over="raise"):
            yield
    except (CoreError, MemoryError):
        raise
    except Exception as error:
        raise CannotBeEmbeddedError("the method fails on this surface") from error


def check_finite(*arrays: object) -> None:
    """Raise FloatingPointError if a result of compiled loops or other libraries is NaN or infinite."""
    for array in arrays:
        if not np.isfinite(np.asarray(array, dtype=np.float64)).all():
            raise FloatingPointError("a result is not finite")
