"""The compilation of the kernels: once for a processor, by two processes side by side.

numba keeps compiled functions beside their sources or in a folder of its own. A stamp there tells that all of
them are compiled, and a lock lets other processes wait for the one that compiles. That one has a second
process for the kernels of matching, which take as long as all others.
"""

import fcntl
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b
from importlib import import_module, resources
from pathlib import Path
from types import ModuleType

import llvmlite.binding
import numba
from numba.core.dispatcher import Dispatcher

from core.descriptors import network_views
from core.parameters import Parameters
from service.compute.tasks import warm, warm_matching, warm_surfaces

COMPILING_SECONDS = 3600.0
"""The longest start of a worker process that compiles them, or waits for the process that does."""

ASK_SECONDS = 0.2

STAMPED = "service.rendering.thumbnail"
"""The module of one kernel, beside whose compiled form the stamp is."""


def is_compiled(parameters: Parameters) -> bool:
    """Return whether the kernels of some parameters are compiled for this processor."""
    return _stamp(parameters).exists()


def warm_once_compiled(parameters: Parameters) -> None:
    """Warm a worker process up; of several processes, the first compiles the kernels and the others wait."""
    compile_kernels(parameters)
    warm(parameters)
    if network_views.is_available():
        network_views.session()


def compile_kernels(
    parameters: Parameters, advance: Callable[[int, int], object] = lambda done, total: None
) -> bool:
    """Compile the kernels of some parameters, unless they are compiled; return whether this process did.

    `advance` is called several times a second with the number of compiled functions, and of all.
    """
    if is_compiled(parameters):
        return False
    stamp = _stamp(parameters)
    with _alone(stamp.with_suffix(".lock")):
        if stamp.exists():
            return False
        with _watched(advance):
            _compile_side_by_side(parameters)
            warm(parameters)
        # Where nothing can be written, every process compiles.
        with suppress(OSError):
            stamp.touch()
        return True


def _compile_side_by_side(parameters: Parameters) -> None:
    """Compile the kernels of matching in a process of its own, and meanwhile those of surfaces in this one.

    Kernels that a failed process leaves are compiled by the caller, who runs all of them.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return
    code = "from service.compute.compilation import _compile_matching as run; run()"
    # -P: files in the working folder are not part of the program.
    with subprocess.Popen([sys.executable, "-P", "-c", code], stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        try:
            process.stdin.write(pickle.dumps(parameters))
            process.stdin.flush()
            warm_surfaces(parameters)
            process.wait()
        except BaseException:
            process.kill()
            raise


def _compile_matching() -> None:
    """Compile the kernels of matching, for the parameters that another process sends."""
    parameters = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_sender, daemon=True, name="isoshape-sender").start()
    warm_matching(parameters)


def _end_with_sender() -> None:
    """End this process when the process that holds the other end of its standard input ends."""
    # Not sys.stdin: a thread that waits in its buffer would hold up the end of the interpreter.
    while os.read(0, 1):
        pass
    os._exit(1)


@contextmanager
def _watched(advance: Callable[[int, int], object]) -> Iterator[None]:
    """Call `advance` in a thread for the duration of the block."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(ASK_SECONDS):
            modules = list(sys.modules.items())
            ours = [module for name, module in modules if name.startswith(("core.", "service."))]
            compiled = [bool(kernel.overloads) for kernel in _kernels(ours)]
            advance(sum(compiled), len(compiled))

    thread = threading.Thread(target=watch, daemon=True, name="isoshape-compiling")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _kernels(modules: Iterable[ModuleType]) -> list[Dispatcher]:
    """Return the functions that numba compiles, of some modules."""
    values = [value for module in modules for value in list(vars(module).values())]
    # A function with another one around it is compiled in the latter's place.
    kernels = {
        id(kernel): kernel
        for value in values
        for kernel in (value, getattr(value, "__wrapped__", None))
        if isinstance(kernel, Dispatcher)
    }
    return list(kernels.values())


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Wait for the lock file, and hold it; without a lock where none can be made."""
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError:
        yield
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _stamp(parameters: Parameters) -> Path:
    (kernel,) = _kernels([import_module(STAMPED)])
    folder = kernel.stats.cache_path
    assert folder is not None
    return Path(folder) / f"isoshape-{parameters.fingerprint}-{_state()}.compiled"


@cache
def _state() -> str:
    """Return a hash of what numba looks at: its version, the processor and the sources."""
    state = blake2b(digest_size=8)
    for part in (
        numba.__version__,
        llvmlite.binding.get_host_cpu_name(),
        llvmlite.binding.get_host_cpu_features().flatten(),
        sys.version,
    ):
        state.update(part.encode())
    for package in ("core", "service.rendering"):
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*.py")):
            state.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return state.hexdigest()
