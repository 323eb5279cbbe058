"""`python -m tests.soak.kill --cycles 200`: kill the service so many times, and fail if anything is lost."""

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

from tests.service.processes import server
from tests.soak.kill.cycles import Cycle, run_cycle, verify
from tests.soak.kill.ledger import Ledger


def main() -> int:
    """Run the cycles; 1 at the first fault, with the archive kept."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.kill", description=__doc__)
    parser.add_argument("--cycles", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the moments, and of what is written")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="isoshape-kill-"))
    ledger, cycles, began = Ledger(), list[Cycle](), time.monotonic()
    for number in range(options.cycles):
        cycle = run_cycle(folder, ledger, options.seed * 1_000_000 + number)
        cycles.append(cycle)
        if cycle.faults:
            return fail(folder, f"cycle {number}", cycle.faults)
        if len(cycles) % 10 == 0:
            print(f"{len(cycles)} of {options.cycles} kills", file=sys.stderr)
    with server(folder) as (_, client):
        faults = verify(client, folder, ledger)
    if faults:
        return fail(folder, "the end", faults)
    shutil.rmtree(folder)
    text = summary(cycles, ledger, time.monotonic() - began, options.seed)
    print(text)
    return 0


def summary(cycles: list[Cycle], ledger: Ledger, seconds: float, seed: int) -> str:
    """The outcome of the cycles, as a list."""
    starts = sorted(cycle.start_seconds for cycle in cycles)
    lines = [
        f"{len(cycles)} kills in {seconds:.0f} s, seed {seed}",
        f"{ledger.uploads} uploads and {ledger.deletions} deletions acknowledged: none lost, none torn",
        f"{ledger.found} uploads that were not acknowledged were there, whole",
        f"{sum(cycle.journal for cycle in cycles)} kills in the middle of a commit, rolled back",
        f"ready after {statistics.median(starts):.1f} s (median), {starts[-1]:.1f} s at most",
        f"workers ended within {max(cycle.orphan_seconds for cycle in cycles):.1f} s of the kill",
    ]
    return "\n".join(f"* {line}" for line in lines)


def fail(folder: Path, where: str, faults: list[str]) -> int:
    """Say what is wrong, and where the archive is."""
    print(f"{where}: {len(faults)} faults; the archive is in {folder}", *faults, sep="\n", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
