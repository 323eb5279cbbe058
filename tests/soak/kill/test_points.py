"""Each operation on the disk of each change of an archive: the service is killed at it, or it fails.

`POINTS` of all operations, evenly spread; 0, which `make soak` has, for all.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

POINTS = int(os.environ.get("POINTS") or 9)
ROOT = Path(__file__).parents[3]
COLUMNS = ("operations", "points", "kills", "dropped", "enospc", "eio")

# Acknowledges what it has not synced.
CARELESS = """
import os, sys
from service.storage import files, sqlite
from tests.soak.kill import sweep
files._sync = lambda path: None
prepare = sqlite._prepare
def prepare_carelessly(connection, record):
    prepare(connection, record)
    connection.execute("PRAGMA synchronous = OFF")
sqlite._prepare = prepare_carelessly
sweep.main()
"""


def rows(folder: Path, environment: dict[str, str], *words: str) -> list[dict[str, Any]]:
    """Run the sweep in a process of its own; a row for each change."""
    with (folder / "log.txt").open("w") as log:
        done = subprocess.run(
            [sys.executable, *words],
            check=False,
            env=environment,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
    assert done.returncode == 0, (folder / "log.txt").read_text()[-4000:]
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_every_operation_of_every_change(tmp_path: Path, preloaded: dict[str, str]) -> None:
    table = rows(tmp_path, preloaded, "-m", "tests.soak.kill.sweep", str(tmp_path), str(POINTS))
    print(f"{'change':17}", *(f"{column:>10}" for column in (*COLUMNS, "faults", "ready s")))
    for row in table:
        counts = [row[column] for column in COLUMNS] + [len(row["faults"])]
        print(f"{row['name']:17}", *(f"{count:10}" for count in counts), f"{row['ready_seconds']:10.2f}")
    print(f"{'all':17}", *(f"{sum(row[column] for row in table):10}" for column in COLUMNS))
    faults = [fault for row in table for fault in row["faults"]]
    # A traceback is longer than what the report of an assertion shows.
    print(*faults, sep="\n")
    assert not faults
    assert sum(row["operations"] for row in table) >= 1000
    if not POINTS:
        assert all(row["points"] == row["operations"] + 1 for row in table)


def test_what_is_acknowledged_and_not_synced_is_found(tmp_path: Path, preloaded: dict[str, str]) -> None:
    changes = ("delete", "isoshape backup")
    for row in rows(tmp_path, preloaded, "-c", CARELESS, str(tmp_path), "9", *changes):
        assert any("acknowledged and lost" in fault for fault in row["faults"]), row
