"""`python -m tests.soak.hostile`: upload every hostile file to a service, and print the table of answers."""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.soak.hostile.corpus import CORPUS
from tests.soak.hostile.serving import memory, server
from tests.soak.hostile.uploading import memory_after, table, upload_each

ROUNDS = 3


def main() -> int:
    """0 if every file was answered as it must be."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.hostile", description=__doc__)
    parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as (pid, client):
        held = {"before the first file": memory(pid)}
        outcomes = upload_each(pid, client, CORPUS)
        held["after all of them"] = memory(pid)
        usual = [case for case in CORPUS if not case.slow]
        for number, after in enumerate(memory_after(pid, client, usual, ROUNDS), start=1):
            held[f"after {number} more of {len(usual)} files"] = after
    print(table(outcomes, held))
    return 0 if all(outcome.right for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
