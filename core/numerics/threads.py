"""Linear algebra on one thread: several threads change the order of sums, and with it the last bits."""

from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module

from threadpoolctl import ThreadpoolController


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
