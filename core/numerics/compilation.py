"""Compilation of inner loops by numba, with decorators that keep the types of functions."""

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
"""Flags of LLVM: no float is NaN or infinite, and the sign of zero does not matter.

Reassociation and contraction stay off. They depend on inlining, so the process that compiles a function would
compute other last bits than the processes that load it from the cache.
"""


def constant(array: NDArray[T]) -> NDArray[T]:
    """Return a contiguous read-only view: numba compiles a function once more for each kind of array."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function for the types of its arguments; cached on disk, runs without the GIL."""
    return cast("Callable[P, R]", njit(cache=True, nogil=True)(function))


def compiled_sum(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with sums in the order that suits SIMD registers.

    The last bits of a sum depend on the processor. The function must not call another compiled one: see
    `FINITE`.
    """
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath={"reassoc", "nsz"})(function))


def compiled_fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with products and sums fused: on processors with FMA each rounds once.

    The function must not call another compiled one: see `FINITE`.
    """
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath={"contract"})(function))


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for finite floats, for the functions of `core.matching.kernels`, which call one another.

    Numba's cache notices changes of a function's own file only. Its key includes the function's name, so a
    hash of all source files of the package is added to the name.
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
