"""The confined process that reads uploads.

Uploads are untrusted, and a hostile file may take over the code that reads it. A reader therefore has little
memory and time, opens no files and starts no processes, and is replaced often. A file that ends the reader
costs one request.
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
"""Files that a reader reads before a new process replaces it."""

# Prefixes of Python's audit events.
_FORBIDDEN = (
    *("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "os.system", "shutil."),
    *("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod"),
)
# The largest file that cascadio may write: it returns its result through files in memory.
_CONVERTED_BYTES = 256 * 1024**2
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC


@dataclass(frozen=True)
class Readable:
    """A mesh, and the wall time of reading it in milliseconds."""

    mesh: Mesh
    milliseconds: float


def read_file(data: bytes, format: str, limits: Limits, seconds: float) -> Readable:
    """Read a file within `seconds` of processor time; the system ends the process after that time.

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
    """Load everything that reading needs, then confine this process for good.

    Parameters
    ----------
    memory : int
        Bytes of address space; an idle reader takes about 300 MB. Larger allocations raise `MemoryError`.
    """
    for format in FORMATS:
        read_mesh(write_mesh(_triangle(), format), format)
    # Without cascadio, STEP is refused.
    with suppress(MeshError), _converting("step"):
        read_mesh(b"ISO-10303-21;", "step")
    if sys.platform == "linux":
        # Other systems do not enforce the limit, or count differently.
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
    """Let cascadio write files, and discard its messages, which repeat text of the untrusted file."""
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
