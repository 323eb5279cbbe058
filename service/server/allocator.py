"""The memory allocator of the service's process: it returns freed memory to the system."""

import ctypes
import sys

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Parameters of `mallopt` in the GNU C library (malloc.h)."""

KEPT = 8 * 1024 * 1024
"""Bytes of freed memory that a heap keeps at its end, and the least block that has pages of its own."""


def return_freed_memory() -> None:
    """Let each heap of this process keep at most `KEPT` bytes of freed memory at its end.

    The GNU C library otherwise raises both limits with the sizes of freed blocks, up to 64 and 32 MiB: each
    heap, of which a service with threads has several, then keeps as much as the large files that it received.
    Child processes have limits of their own. Other C libraries are left as they are.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_TRIM_THRESHOLD, KEPT)
        mallopt(M_MMAP_THRESHOLD, KEPT)
