"""Compilation of inner loops by numba, with decorators that keep the types of functions.

All functions compile in 53 s of one core, and are loaded from a cache later. Seconds of the longest, with all
that they call, and how many times as long their results take in NumPy or SciPy (a mesh of 3,000 vertices):

    compare_many, which is all of matching                  34.5 s     190 times
    splines of a match record                                3.7 s       8 times
    farthest points and geodesics by Dial's queue            3.1 s     830 and 7 times
    spin images                                              1.1 s      26 times
    radix sort of a million rows                             0.9 s      15 times
    areas of faces, lengths of edges, connected components   0.7 s      17, 13 and 3 times
"""

from collections.abc import Callable
from functools import cache, wraps
from hashlib import blake2b
from importlib import resources
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.core.compiler_lock import global_compiler_lock
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


def compiled_for_reading(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for a function that no other calls and that writes into none of its arrays.

    All of its arrays are passed as `constant`.
    """
    dispatcher: Any = njit(cache=True, nogil=True)(function)

    @wraps(dispatcher)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        values = (constant(value) if isinstance(value, np.ndarray) else value for value in arguments)
        result: R = dispatcher(*values, **named)
        return result

    return call


def compiled_sum(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with sums in the order that suits SIMD registers.

    The last bits of a sum depend on the processor. The function must not call another compiled one: see
    `FINITE`.
    """
    return cast("Callable[P, R]", njit(cache=True, nogil=True, fastmath={"reassoc", "nsz"})(function))


def compiled_fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with products and sums fused: on processors with FMA each rounds once.

    Equal operations on neighbouring numbers share a SIMD register, which numba leaves out by default. The
    function must not call another compiled one: see `FINITE`.
    """
    dispatcher: Any = njit(cache=True, nogil=True, fastmath={"contract"})(function)
    compile_for, flags = dispatcher.compile, cast("Any", config)

    def compile_with_registers(signature: object) -> object:
        with global_compiler_lock:
            default, flags.SLP_VECTORIZE = flags.SLP_VECTORIZE, 1
            try:
                return compile_for(signature)
            finally:
                flags.SLP_VECTORIZE = default

    dispatcher.compile = compile_with_registers
    return cast("Callable[P, R]", dispatcher)


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for finite floats, for the functions of `core.matching.kernels`, which call one another.

    Numba's cache notices changes of a function's own file only. Its key includes the function's name, so a
    hash of all source files of the package is added to the name.
    """
    return _kernel(function, inline=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `kernel`, for a short function that runs in an inner loop: its callers contain it."""
    return _kernel(function, inline=True)


def _kernel(function: Callable[P, R], *, inline: bool) -> Callable[P, R]:
    function.__qualname__ = f"{function.__name__}_{_kernel_sources()}"
    compiler = njit(cache=True, nogil=True, fastmath=FINITE, error_model="numpy", forceinline=inline)
    return cast("Callable[P, R]", compiler(function))


@cache
def _kernel_sources() -> str:
    folder = resources.files("core.matching.kernels")
    state = blake2b(
        resources.files("core").joinpath("numerics", "compilation.py").read_bytes(), digest_size=6
    )
    for name in sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".py")):
        state.update(folder.joinpath(name).read_bytes())
    return state.hexdigest()
