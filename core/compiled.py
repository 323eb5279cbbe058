"""The compiler of the inner loops, with the types kept for the reader and the type checker."""

from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from importlib import resources
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


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled_fast`, for the functions of `core.kernels`, which call one another across files.

    The cache on disk is renewed when a function's own file changes. It also goes by the function's name, so
    that is given a hash of all the package's sources.
    """
    function.__qualname__ = f"{function.__name__}_{_kernel_sources()}"
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath=True, error_model="numpy")(function))


@cache
def _kernel_sources() -> str:
    folder = resources.files("core.kernels")
    state = blake2b(digest_size=6)
    for name in sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".py")):
        state.update(folder.joinpath(name).read_bytes())
    return state.hexdigest()
