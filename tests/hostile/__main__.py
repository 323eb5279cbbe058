"""`python -m tests.hostile`: upload every hostile file to a service, and write what came of it."""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.hostile.corpus import CORPUS
from tests.hostile.serving import memory, server
from tests.hostile.table import page
from tests.hostile.uploading import memory_after, upload_each

ROUNDS = 2


def main() -> int:
    """0 if every file was answered as it must be."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--out", type=Path, help="the page to write; it is printed otherwise")
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as (pid, client):
        at_rest = memory(pid)
        outcomes = upload_each(pid, client, CORPUS)
        after = memory_after(pid, client, [case for case in CORPUS if not case.slow], ROUNDS)
    text = page(outcomes, at_rest, after)
    if out is None:
        print(text)
    else:
        out.write_text(text, encoding="utf-8")
    return 0 if all(outcome.right for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
