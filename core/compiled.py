"""The compiler of the inner loops, with the types kept for the reader and the type checker."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function compiled for the types it is called with, cached on disk, running without the GIL."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True)(function))


def compiled_fast(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with sums of floats reordered so that they can be vectors (no NaN may enter)."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath=True)(function))
