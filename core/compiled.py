"""The compiler of the inner loops, with the types kept for the reader and the type checker."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")


T = TypeVar("T", bound=np.generic)


def constant(array: NDArray[T]) -> NDArray[T]:
    """A view that cannot be written to: arrays that can and cannot be would each compile a function anew."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function compiled for the types it is called with, cached on disk, running without the GIL."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True)(function))


def compiled_fast(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with sums of floats reordered so that they can be vectors (no NaN may enter)."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath=True)(function))
