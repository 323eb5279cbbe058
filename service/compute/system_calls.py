"""The confinement of a reader by Linux, which native code cannot leave: Landlock and seccomp."""

import errno
import os
from importlib import import_module
from typing import Any


def _imported(name: str) -> Any:  # noqa: ANN401
    """A package, or None where the system lacks it or its library."""
    try:
        return import_module(name)
    except (ImportError, RuntimeError, OSError):
        return None


# Here: a confined process could not load them.
landlock, seccomp = _imported("landlock"), _imported("pyseccomp")

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


def forbid_files() -> bool:
    """Refuse every file of this thread, and of the threads that it starts, by its path (Landlock); for good.

    Files in memory, which have no path, can be opened.

    Returns
    -------
    bool
        Whether the kernel does so.
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

    A refused call fails with EPERM.

    Parameters
    ----------
    opening : bool
        Whether files may be opened: where `forbid_files` holds, files in memory only.

    Returns
    -------
    bool
        Whether the kernel does so.
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
