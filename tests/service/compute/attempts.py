"""Attempts of native code and Python in a reader of uploads; a reader imports little to run them."""

import ctypes
import os
import pickle
import socket
import stat
import struct
import subprocess
import time
from contextlib import suppress

from service.compute import sandbox

MEMORY = 1024**3
"""The least that the settings allow. An idle reader takes 760 to 790 MB, and these tests 90 more."""


def enter() -> None:
    """Confine a process that has these attempts loaded, since it could not load them any more."""
    sandbox.enter(MEMORY)


def load() -> None:
    """Do nothing, in a process that then has these attempts loaded."""


def open_for(path: str, mode: str) -> str | bytes:
    with open(path, mode) as file:
        return file.read(1)


def resolve(host: str) -> object:
    return socket.getaddrinfo(host, 80)


def connect(port: int) -> None:
    socket.create_connection(("127.0.0.1", port), timeout=1).close()


def start(command: str) -> int:
    return subprocess.run([command], check=True).returncode


ATTEMPTS = {
    "open": lambda libc, _: libc.open(b"/etc/passwd", os.O_RDONLY),
    "open the program": lambda libc, _: libc.open(os.__file__.encode(), os.O_RDONLY),
    "open memory": lambda libc, _: libc.open(b"/proc/self/mem", os.O_RDWR),
    "write": lambda libc, folder: libc.open(f"{folder}/new".encode(), os.O_WRONLY | os.O_CREAT, 0o600),
    "create": lambda libc, folder: libc.creat(f"{folder}/new".encode(), 0o600),
    "remove": lambda libc, folder: libc.unlink(f"{folder}/kept".encode()),
    "own": lambda libc, folder: libc.chown(f"{folder}/kept".encode(), 0, 0),
    "mode": lambda libc, folder: libc.chmod(f"{folder}/kept".encode(), 0o777),
    "connect": lambda libc, _: libc.socket(socket.AF_INET, socket.SOCK_STREAM, 0),
    "fork": lambda libc, _: libc.fork(),
    "execute": lambda libc, _: libc.execv(b"/bin/true", None),
    "kill": lambda libc, _: libc.kill(os.getppid(), 0),
    "trace": lambda libc, _: libc.ptrace(16, os.getppid(), None, None),
    "limits of another": lambda libc, _: libc.prlimit(os.getppid(), 7, None, ctypes.create_string_buffer(16)),
}


def attempt(name: str, folder: str) -> list[int]:
    """Call the C library without Python's help; the result and the error number."""
    libc = ctypes.CDLL(None, use_errno=True)
    return [ATTEMPTS[name](libc, folder), ctypes.get_errno()]


class Evil:
    """An object that runs a command where it is unpickled."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> object:
        return os.mkdir, (self.path,)


def send_evil(path: str) -> None:
    """Answer by the pipe itself, as native code in the reader could."""
    answer = pickle.dumps((True, Evil(path)))
    _send(struct.pack("!i", len(answer)) + answer)


def send_half() -> None:
    """Begin an answer by the pipe itself, and never end it."""
    _send(struct.pack("!i", 1000) + b"V")
    time.sleep(600)


def _send(data: bytes) -> None:
    for descriptor in range(3, 64):
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                os.write(descriptor, data)


def spin(seconds: float) -> None:
    """Use processor time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def hold(size: int) -> None:
    """Keep so many bytes of memory."""
    _HELD.append(bytearray(b"x") * size)


_HELD: list[bytearray] = []
