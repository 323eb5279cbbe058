"""The confined process that reads uploads.

Uploads are untrusted, and a hostile file may take over the code that reads it. A reader therefore has little
memory and time, opens no files and starts no processes, and is replaced often. On Linux the kernel enforces
this on native code by Landlock and seccomp; on every system an audit hook enforces it on Python. A
file that ends the reader costs one request.

A reader answers by a mesh or the parts of an assembly, as safetensors, or by the directory of a ZIP, as JSON.
It is not trusted, so each answer is checked as an upload is.
"""

import codecs
import errno
import io
import json
import math
import os
import resource
import sys
import sysconfig
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

import core.io
from core.errors import CoreError, MalformedMeshError, MeshError, MeshTooComplexError
from core.io import (
    PATH_NAMES,
    Limits,
    MeshFile,
    by_ending,
    clean_name,
    read_mesh,
    read_parts,
    writable,
    write_mesh,
)
from core.mesh.mesh import Mesh
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

ALLOWED = (
    # Memory.
    *("brk", "mmap", "munmap", "mremap", "mprotect", "madvise", "membarrier"),
    # Files that are open, files in memory, and the state of other files.
    *("read", "readv", "pread64", "write", "writev", "lseek", "close", "dup", "dup2", "dup3", "fcntl"),
    *("fstat", "newfstatat", "stat", "lstat", "statx", "readlink", "readlinkat", "getcwd"),
    *("memfd_create", "ftruncate", "poll", "ppoll", "select", "pselect6"),
    # Threads and signals of the process.
    *("futex", "rseq", "set_robust_list", "set_tid_address", "sched_yield", "sched_getaffinity", "getcpu"),
    *("tgkill", "rt_sigaction", "rt_sigprocmask", "rt_sigreturn", "sigaltstack", "restart_syscall"),
    *("exit", "exit_group"),
    # Time, limits and identity of the process.
    *("clock_gettime", "clock_getres", "clock_nanosleep", "nanosleep", "gettimeofday", "time", "times"),
    *("getrusage", "getrlimit", "setrlimit", "prlimit64", "getrandom", "sysinfo", "uname"),
    *("getpid", "gettid", "getppid", "getuid", "geteuid", "getgid", "getegid", "arch_prctl"),
)
"""Names of system calls; an architecture lacks some of them. None opens a file by its path, starts or signals
another process, or makes a connection."""


OPENING = ("open", "openat")

_confinement: dict[str, bool] = {}


def _imported(name: str) -> Any:  # noqa: ANN401
    """Return a package, or None where the system lacks it or its library."""
    try:
        return import_module(name)
    except (ImportError, RuntimeError, OSError):
        return None


# Here: a confined process could not load them.
landlock, seccomp = _imported("landlock"), _imported("pyseccomp")


def read_file(data: bytes, format: str, limits: Limits, seconds: float) -> bytes:
    """Read a file within `seconds` of processor time; the system ends the process after that time.

    Nothing that a reader returns is unpickled: `mesh_from_bytes` reads it. A MeshError tells by
    its subclass why the file cannot be used.
    """
    _limit_time(seconds)
    start = time.perf_counter()
    with _converting(format):
        file = core.io.read_file(data, format, limits=limits)
    return mesh_to_bytes(file, 1e3 * (time.perf_counter() - start))


def read_part_files(data: bytes, format: str, limits: Limits, seconds: float) -> bytes:
    """Read the parts of an assembly and write each as a 3MF, for `parts_from_bytes`, as `read_file` does."""
    _limit_time(seconds)
    with _converting(format):
        parts = read_parts(data, format, limits=limits)
    return parts_to_bytes(
        [PartFile(part.name, part.path, part.instances, write_mesh(part.mesh, "3mf")) for part in parts]
    )


def read_zip_directory(end: bytes, size: int, most: int, seconds: float) -> bytes:
    """Return `zip_directory(end, size, most)` within `seconds` of processor time."""
    _limit_time(seconds)
    return zip_directory(end, size, most)


def zip_directory(end: bytes, size: int, most: int) -> bytes:
    """List the directory of a ZIP of `size` bytes, of which `end` is the last part.

    A directory of a few megabytes can keep the library busy for minutes. Return JSON: the number of entries
    and, unless they are more than `most`, a list for each entry but folders: its path, flags, method,
    external attributes, position in the file, packed size, size and CRC-32. Raise MeshTooComplexError if the
    directory begins before `end`, and ValueError if the bytes are not the end of a ZIP.
    """
    try:
        with zipfile.ZipFile(_FileEnd(end, size)) as archive:
            infos = archive.infolist()
    except MeshTooComplexError:
        raise
    # Hostile directories can make the library raise any exception.
    except Exception as error:
        raise ValueError(str(error)) from error
    entries = [
        [
            *(info.orig_filename, info.flag_bits, info.compress_type, info.external_attr),
            *(info.header_offset, info.compress_size, info.file_size, info.CRC),
        ]
        for info in infos[:most]
        if not info.is_dir()
    ]
    return json.dumps([len(infos), entries if len(infos) <= most else []]).encode()


class _FileEnd(io.BytesIO):
    """The last bytes of a file of `size` bytes, at their positions in it."""

    def __init__(self, end: bytes, size: int) -> None:
        super().__init__(end)
        self._start = size - len(end)

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        if whence == os.SEEK_SET:
            if 0 <= offset < self._start:
                raise MeshTooComplexError("the directory is too long for the largest number of members")
            offset -= self._start
        return super().seek(offset, whence) + self._start

    def tell(self) -> int:
        return super().tell() + self._start


def enter(memory: int) -> None:
    """Load everything that reading needs, then confine this process for good.

    `memory` has the bytes of address space; an idle reader takes 760 to 790 MB. Larger allocations raise
    `MemoryError`.
    """
    triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
    for format in writable():
        read_mesh(write_mesh(triangle, format), format)
    # ZIP files name their members in this encoding.
    codecs.lookup("cp437")
    # A polygon that is not convex.
    read_mesh(b"OFF\n5 1 0\n0 0 0\n2 0 0\n2 2 0\n1 1 0\n0 2 0\n5 0 1 2 3 4\n", "off")
    # Without cascadio, STEP and IGES are refused.
    for ending, beginning in (("step", b"ISO-10303-21;"), ("iges", b"IGES")):
        with suppress(MeshError), _converting(ending):
            read_mesh(beginning, ending)
    if sys.platform == "linux":
        # Other systems do not enforce the limit, or count differently.
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, _CONVERTED_BYTES))
    project = {str(Path(sys.modules[name].__file__ or "").parent) for name in ("core", "service")}
    folders = {sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), *project}
    program = tuple(f"{Path(folder).resolve()}{os.sep}" for folder in folders)

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
    """Return whether each part of the system confines this process; empty before `enter`."""
    return dict(_confinement)


@contextmanager
def _converting(format: str) -> Iterator[None]:
    """Let cascadio write files, and discard its messages, which repeat text of the untrusted file."""
    known = by_ending(format)
    if known is None or not known.package:
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
    """Return a descriptor of the null device, which a confined process cannot open."""
    return os.open(os.devnull, os.O_WRONLY)


def forbid_files() -> bool:
    """Refuse every file of this thread, and of the threads that it starts, by its path (Landlock); for good.

    Files in memory, which have no path, can be opened. Return whether the kernel does so.
    """
    if landlock is None:
        return False
    try:
        landlock.Ruleset().apply()
    except (OSError, ValueError, landlock.LandlockError):
        # ValueError: where the kernel refuses, the package reads its version, which may be 5.15.133+.
        return False
    return True


def allow_calls(*, opening: bool) -> bool:
    """Refuse all system calls but `ALLOWED` to this process, and new privileges (seccomp); for good.

    A refused call fails with EPERM. With `opening`, files may be opened: where `forbid_files` holds, files in
    memory only. Return whether the kernel does so.
    """
    if seccomp is None:
        return False
    # abort() sends a signal to its own process; prlimit64 takes 0 for that.
    own = {"tgkill": os.getpid(), "prlimit64": 0}
    try:
        rules = seccomp.SyscallFilter(seccomp.ERRNO(errno.EPERM))
        rules.set_attr(seccomp.Attr.CTL_TSYNC, 1)
        for name in ALLOWED + (OPENING if opening else ()):
            try:
                number = seccomp.resolve_syscall(seccomp.Arch.NATIVE, name)
            except OSError:
                continue
            if number < 0:
                # Such a rule would be refused, and the whole filter with it.
                continue
            conditions = [seccomp.Arg(0, seccomp.EQ, own[name])] if name in own else []
            rules.add_rule(seccomp.ALLOW, number, *conditions)
        rules.load()
    except OSError:
        return False
    return True


_ABOUT = "about"
# The most characters of the warnings of one file.
_WARNING_CHARACTERS = 1_000


def largest_size(limits: Limits) -> int:
    """Return the most bytes of `mesh_to_bytes`: three numbers of 64 bits for each vertex and face, and names.

    An STL file has three vertices for each face, which are counted once they are merged.
    """
    return 24 * (max(limits.vertices, 3 * limits.faces) + limits.faces) + 64 * 1024


def mesh_to_bytes(file: MeshFile, milliseconds: float) -> bytes:
    """Return the bytes that `mesh_from_bytes` reads: a mesh, warnings, and the wall time of reading it."""
    arrays: dict[str, NDArray[Any]] = {
        "vertices": np.ascontiguousarray(file.mesh.vertices, dtype=np.float64),
        "faces": np.ascontiguousarray(file.mesh.faces, dtype=np.int64),
        "warnings": np.frombuffer(("\n".join(file.warnings) + "\n").encode(), dtype=np.uint8),
        "milliseconds": np.array([milliseconds]),
    }
    return bytes(save(arrays))


def mesh_from_bytes(data: bytes) -> tuple[MeshFile, float]:
    """Return what an untrusted process has read, checked as any mesh, and the time in milliseconds.

    Raise MalformedMeshError if the bytes are not a mesh.
    """
    try:
        arrays = load(data)
        vertices, faces, milliseconds = (arrays[name] for name in ("vertices", "faces", "milliseconds"))
        if vertices.dtype != np.float64 or faces.dtype != np.int64:
            raise TypeError("arrays of another type")
        warnings = bytes(arrays["warnings"]).decode("ascii")[:_WARNING_CHARACTERS].split("\n")
        if not all(map(str.isprintable, warnings)):
            raise ValueError("warnings that cannot be shown")
        return MeshFile(Mesh(vertices, faces), tuple(filter(None, warnings))), float(milliseconds.item())
    except (SafetensorError, CoreError, KeyError, TypeError, ValueError) as error:
        raise MalformedMeshError("a reader returned no mesh") from error


@dataclass(frozen=True)
class PartFile:
    """A distinct part of an assembly, as a 3MF: see `core.io.Part`."""

    name: str
    path: tuple[str, ...]
    instances: int
    data: bytes


def parts_to_bytes(parts: list[PartFile]) -> bytes:
    """Return the bytes that `parts_from_bytes` reads."""
    about = json.dumps([[part.name, part.path, part.instances] for part in parts]).encode()
    arrays = {str(number): part.data for number, part in enumerate(parts)} | {_ABOUT: about}
    return bytes(save({name: np.frombuffer(data, dtype=np.uint8) for name, data in arrays.items()}))


def parts_from_bytes(data: bytes, most: int) -> list[PartFile]:
    """Return at most `most` parts that an untrusted process has read; their files are read as any uploads.

    Raise MalformedMeshError if the bytes are not parts.
    """
    try:
        arrays = {name: array.tobytes() for name, array in load(data).items()}
        parts = [
            PartFile(name, tuple(path), instances, arrays[str(number)])
            for number, (name, path, instances) in enumerate(json.loads(arrays[_ABOUT]))
        ]
        if len(parts) > most or not all(map(_is_sound, parts)):
            raise ValueError("no parts of an assembly")
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise MalformedMeshError("a reader returned no parts") from error
    return parts


def _is_sound(part: PartFile) -> bool:
    return (
        all(type(text) is str and text == clean_name(text) for text in (part.name, *part.path))
        and len(part.path) <= PATH_NAMES
        and type(part.instances) is int
        and part.instances >= 1
    )
