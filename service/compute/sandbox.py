"""The process that reads uploads: what it may use, and what it does.

Files come from strangers, and a reader may be brought to do what no one meant it to. So it has little memory
and little time, opens and starts nothing, and is replaced often. A file that ends it costs one request.
"""

import math
import os
import resource
import sys
import sysconfig
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from core.errors import MeshError
from core.io import FORMATS, Limits, read_mesh, write_mesh
from core.mesh.mesh import Mesh

FILES_EACH = 100
"""A process is replaced after so many files."""

# Beginnings of the names of Python's audit events.
_FORBIDDEN = (
    *("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "os.system", "shutil."),
    *("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod"),
)
# What cascadio may write: it passes what it made on through files in memory.
_CONVERTED_BYTES = 256 * 1024**2
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC


@dataclass(frozen=True)
class Readable:
    """A mesh that was read, and the wall time that took in milliseconds."""

    mesh: Mesh
    milliseconds: float


def read_file(data: bytes, format: str, limits: Limits, seconds: float) -> Readable:
    """Read a file within so many seconds of processor time; the process ends when they are over.

    Raises
    ------
    MeshError
        The file cannot be used; the subclass says why.
    """
    used = math.fsum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + seconds), most))
    start = time.perf_counter()
    with _converting(format):
        mesh = read_mesh(data, format, limits=limits)
    return Readable(mesh, 1e3 * (time.perf_counter() - start))


def enter(memory: int) -> None:
    """Confine this process for good, after everything that reading needs is loaded.

    Parameters
    ----------
    memory : int
        Bytes of address space; what does not fit raises `MemoryError`. About 300 MB are taken at rest.
    """
    for format in FORMATS:
        read_mesh(write_mesh(_triangle(), format), format)
    # Where cascadio is not there, STEP is refused.
    with suppress(MeshError), _converting("step"):
        read_mesh(b"ISO-10303-21;", "step")
    if sys.platform == "linux":
        # Elsewhere the limit is not kept, or is counted otherwise.
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, _CONVERTED_BYTES))
    program = tuple(
        f"{Path(folder).resolve()}{os.sep}"
        for folder in {sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), *_own_folders()}
    )

    def refuse(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, int) or path == os.devnull:
                return
            for_writing = isinstance(flags, int) and flags & _WRITES
            if for_writing or not str(Path(os.fsdecode(path)).resolve()).startswith(program):  # type: ignore[arg-type]
                raise PermissionError(f"a reader of uploads may not open {path!r}")
        elif event.startswith(_FORBIDDEN):
            raise PermissionError(f"a reader of uploads may do no {event}")

    sys.addaudithook(refuse)


@contextmanager
def _converting(format: str) -> Iterator[None]:
    """Let cascadio write what it must, and say nothing: what it says repeats what strangers wrote."""
    if format != "step":
        yield
        return
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream, _ in kept:
        os.dup2(nowhere, stream)
    os.close(nowhere)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, most))
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)


def _own_folders() -> list[str]:
    """The folders of this project's packages."""
    return [str(Path(sys.modules[name].__file__ or "").parent) for name in ("core", "service")]


def _triangle() -> Mesh:
    """The smallest mesh."""
    return Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
