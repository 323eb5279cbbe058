"""The confined process that reads uploads.

Uploads are untrusted, and a hostile file may take over the code that reads it. A reader therefore has little
memory and time, opens no files and starts no processes, and is replaced often. On Linux the kernel enforces
this on native code (`service.compute.system_calls`); on every system an audit hook enforces it on Python. A
file that ends the reader costs one request.
"""

import codecs
import math
import os
import resource
import sys
import sysconfig
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from core.errors import MeshError
from core.io import FORMATS, Limits, read_mesh, read_parts, write_mesh
from core.mesh.mesh import Mesh
from service.compute import part_bytes
from service.compute.mesh_bytes import ReadMesh, to_bytes
from service.compute.part_bytes import PartFile
from service.compute.system_calls import allow_calls, forbid_files
from service.compute.worker_loop import end_with_parent

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

_confinement: dict[str, bool] = {}


def read_file(data: bytes, format: str, limits: Limits, seconds: float) -> bytes:
    """Read a file within `seconds` of processor time; the system ends the process after that time.

    Returns
    -------
    bytes
        Of `service.compute.mesh_bytes.from_bytes`: nothing that a reader returns is unpickled.

    Raises
    ------
    MeshError
        The file cannot be used; the subclass says why.
    """
    _limit_time(seconds)
    start = time.perf_counter()
    with _converting(format):
        mesh = read_mesh(data, format, limits=limits)
    return to_bytes(ReadMesh(mesh, 1e3 * (time.perf_counter() - start)))


def read_part_files(data: bytes, format: str, limits: Limits, seconds: float) -> bytes:
    """Read the parts of an assembly and write each as a 3MF, within `seconds` of processor time.

    Returns
    -------
    bytes
        Of `service.compute.part_bytes.from_bytes`.

    Raises
    ------
    MeshError
        The file cannot be used; the subclass says why.
    """
    _limit_time(seconds)
    with _converting(format):
        parts = read_parts(data, format, limits=limits)
    return part_bytes.to_bytes(
        [PartFile(part.name, part.path, part.instances, write_mesh(part.mesh, "3mf")) for part in parts]
    )


def enter(memory: int) -> None:
    """Load everything that reading needs, then confine this process for good.

    Parameters
    ----------
    memory : int
        Bytes of address space; an idle reader takes 760 to 790 MB. Larger allocations raise `MemoryError`.
    """
    for format in FORMATS:
        read_mesh(write_mesh(_triangle(), format), format)
    # ZIP files name their members in this encoding.
    codecs.lookup("cp437")
    # Without cascadio, STEP is refused.
    with suppress(MeshError), _converting("step"):
        read_parts(b"ISO-10303-21;", "step")
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
    no_files = forbid_files()
    # A thread that begins now is confined as this one is.
    end_with_parent()
    # STEP is converted through files in memory, which are opened.
    no_calls = allow_calls(opening=no_files or find_spec("cascadio") is not None)
    _confinement.update(landlock=no_files, seccomp=no_calls)


def _limit_time(seconds: float) -> None:
    """Have the system end the process after `seconds` more of processor time."""
    used = math.fsum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + seconds), most))


def confinement() -> dict[str, bool]:
    """Whether the system confines this process, by the name of its part; empty before `enter`."""
    return dict(_confinement)


@contextmanager
def _converting(format: str) -> Iterator[None]:
    """Let cascadio write files, and discard its messages, which repeat text of the untrusted file."""
    if format != "step":
        yield
        return
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    for stream, _ in kept:
        os.dup2(_null_device(), stream)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, most))
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)


@cache
def _null_device() -> int:
    """A descriptor of the null device, which a confined process cannot open."""
    return os.open(os.devnull, os.O_WRONLY)


def _own_folders() -> list[str]:
    """The folders of this project's packages."""
    return [str(Path(sys.modules[name].__file__ or "").parent) for name in ("core", "service")]


def _triangle() -> Mesh:
    """The smallest mesh."""
    return Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
