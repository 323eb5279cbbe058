"""Fail unless every process of a container is of its user and may no more: ``confined.py PID USER``.

The container is that of the process, by its namespace of processes.
"""

import sys
from pathlib import Path


def main(pid: str, user: str) -> None:
    """Look at each process that the kernel lists."""
    first = Path("/proc", pid, "ns/pid").readlink()
    wanted = {"Uid": user, "Gid": user, "NoNewPrivs": "1"}
    wanted |= dict.fromkeys(("CapEff", "CapPrm", "CapBnd"), "0" * 16)
    found = 0
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "ns/pid").readlink() != first:
                continue
            status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
        except (FileNotFoundError, PermissionError, ProcessLookupError):
            continue  # It has ended, or is no process of the container's.
        found += 1
        for key, value in wanted.items():
            if set(status[key].split()) != {value}:
                raise SystemExit(f"{status['Name'].strip()}: {key} is {status[key].strip()}")
    if not found:
        raise SystemExit("no process was found")


if __name__ == "__main__":
    main(*sys.argv[1:])
