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

FINITE = {"nnan", "ninf", "nsz"}
"""What the compiler may assume: that no float is NaN or infinite, and that the sign of a zero is nothing.

It may not reorder sums or fuse products with them. How it did so would depend on what it inlines: the process
that compiled a function would find other last bits than those that load it from the cache.
"""


def constant(array: NDArray[T]) -> NDArray[T]:
    """A view that cannot be written to: arrays that can and cannot be would each compile a function anew."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function compiled for the types it is called with, cached on disk, running without the GIL."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True)(function))


def compiled_fast(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for finite floats, of which it finds the least by vectors."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath=FINITE)(function))


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled_fast`, for the functions of `core.matching.kernels`, which call one another across files.

    The cache on disk is renewed when a function's own file changes. It also goes by the function's name, so
    that is given a hash of all the package's sources.
    """
    function.__qualname__ = f"{function.__name__}_{_kernel_sources()}"
    return cast(
        "Callable[P, R]", njit(cache=True, nogil=True, fastmath=FINITE, error_model="numpy")(function)
    )


@cache
def _kernel_sources() -> str:
    folder = resources.files("core.matching.kernels")
    state = blake2b(
        resources.files("core").joinpath("numerics", "compilation.py").read_bytes(), digest_size=6
    )
    for name in sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".py")):
        state.update(folder.joinpath(name).read_bytes())
    return state.hexdigest()
