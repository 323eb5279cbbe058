"""Freed memory goes back to the system."""

import os
import subprocess
import sys

import pytest

from service.server.allocator import KEPT

THREADS = 4

PROGRAM = f"""
import threading
from pathlib import Path
from service.server.allocator import return_freed_memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * {os.sysconf("SC_PAGE_SIZE")}

def receive_files():
    together.wait()
    for size in (8, 16, 24, 24):
        file, copy = b"x" * (size << 20), b"y" * (size << 18)
        del file, copy

{{first}}
together = threading.Barrier({THREADS})
before = resident()
threads = [threading.Thread(target=receive_files) for _ in range({THREADS})]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(resident() - before)
"""


def kept(first: str) -> int:
    """Bytes that a process keeps after its threads freed large blocks."""
    program = PROGRAM.format(first=first)
    return int(subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have another allocator")
def test_each_heap_keeps_little_of_the_memory_of_large_files() -> None:
    # One heap more than threads: that of the main thread.
    assert kept("return_freed_memory()") <= (THREADS + 1) * KEPT < kept("")
