"""`python -m tests.soak.hostile.bit_flips`: flipped bits of an archive, found by `check`.

A flip that is not found must lie in free space: everything that the archive holds then reads as before.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from service.errors import ArchiveError
from service.storage.checking import check
from tests.service.archives import contents, make_archive


def outcome(path: Path, before: dict[str, list[str]]) -> str:
    """What becomes of a flipped bit: "found", "free space", or "missed"."""
    try:
        if check(path, lock_seconds=1).faults:
            return "found"
    except ArchiveError:
        return "found"
    return "free space" if contents(path) == before else "missed"


def main() -> int:
    """0 if no flip was missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.hostile.bit_flips", description=__doc__)
    parser.add_argument("--shapes", type=int, default=50)
    parser.add_argument("--flips", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        archive = make_archive(Path(folder) / "archive.sqlite3", *range(arguments.shapes))
        sound, before = archive.read_bytes(), contents(archive)
        path = Path(folder) / "flipped.sqlite3"
        for bit in (
            np.random.default_rng(arguments.seed).integers(8 * len(sound), size=arguments.flips).tolist()
        ):
            damaged = bytearray(sound)
            damaged[bit // 8] ^= 1 << bit % 8
            path.write_bytes(damaged)
            found = outcome(path, before)
            outcomes[found] += 1
            if found == "missed":
                print(f"bit {bit} (byte {bit // 8}) was missed")
    print(f"{arguments.flips} bits of {len(sound)} bytes, {arguments.shapes} shapes:", dict(outcomes))
    return 1 if outcomes["missed"] else 0


if __name__ == "__main__":
    sys.exit(main())
