"""Linear algebra on one thread: on several, sums are added up in another order, and last bits change."""

from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[object]:
    """While it is entered, NumPy's and SciPy's linear algebra runs on one thread."""
    limited: AbstractContextManager[object] = _controller().limit(limits=1)
    return limited


@cache
def _controller() -> ThreadpoolController:
    """Looks once for the libraries that are loaded, which takes milliseconds."""
    for name in ("numpy.linalg", "scipy.linalg"):
        import_module(name)
    return ThreadpoolController()
