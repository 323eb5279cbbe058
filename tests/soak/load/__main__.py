"""`python -m tests.soak.load --minutes 20`: a mixed load by locust: statuses, times, slope of memory."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from core.gallery import CLASSES, make_shape
from core.io import write_mesh
from service.storage.checking import check
from tests.service.processes import server
from tests.service.support import small_file
from tests.soak.load.memory import Growth, Watch

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
MOST_SLOPE = 1.0
MOST_GROWTH = 15.0
"""MiB: that slope over the judged part of 20 minutes. In a run of five minutes caches still fill, and the
slope alone says little."""
WARM_UP, LEAST_WARM_UP = 0.25, 2.0
"""Share of the time, and the least number of minutes, in which memory may grow: workers meet every kind of
task, pools and caches fill."""
LEAST_JUDGED = 3.0
"""Minutes: in fewer, `MOST_GROWTH` would allow a faster growth."""


def main() -> int:
    """Run the load; 1 if an answer was wrong, the archive is not whole, or memory grows."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.load", description=__doc__)
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--users", type=int, default=8, help="clients at a time")
    parser.add_argument("--locust", type=Path, default=ROOT / ".venv/load/bin/locust")
    options = parser.parse_args()
    warm_up = max(WARM_UP * options.minutes, LEAST_WARM_UP)
    if options.minutes < warm_up + LEAST_JUDGED:
        parser.error(f"{warm_up + LEAST_JUDGED:g} minutes are the least, {LEAST_JUDGED:g} of them judged")
    with tempfile.TemporaryDirectory(prefix="isoshape-load-") as name:
        folder = Path(name)
        write_files(folder)
        # A short queue, so that back-pressure is part of the load.
        with server(folder, ISOSHAPE_WORKERS="2", ISOSHAPE_QUEUE_LENGTH="4") as (process, client):
            watch = Watch(process.pid)
            watch.start()
            subprocess.run(
                [
                    *(options.locust, "--locustfile", HERE / "locustfile.py", "--headless", "--only-summary"),
                    *("--users", str(options.users), "--spawn-rate", str(options.users)),
                    *("--run-time", f"{round(60 * options.minutes)}s", "--host", str(client.base_url)),
                ],
                env={**os.environ, "ISOSHAPE_LOAD_FILES": str(folder)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=False,
            )
            watch.stop()
            stored = client.get("/shapes").json()["total"]
        counts = json.loads((folder / "counts.json").read_text())
        faults = check(folder / "archive.sqlite3", lock_seconds=10).faults
    own, workers = watch.growth(60 * warm_up)
    text = table(options.minutes, options.users, counts, own, workers, stored)
    print(text)
    wrong = [f"{count} times {what}" for what, count in counts["broken"].items()]
    wrong += [f"isoshape check: {fault}" for fault in faults]
    wrong += grown("service", own) + grown("workers", workers)
    for each in wrong:
        print(each, file=sys.stderr)
    return 1 if wrong else 0


def write_files(folder: Path) -> None:
    """Sixty small meshes and one of each class of the gallery."""
    for number in range(60):
        (folder / f"{number}.off").write_bytes(small_file(number))
    for label in CLASSES:
        (folder / f"{label}.off").write_bytes(write_mesh(make_shape(label, 0), "off"))


def table(
    minutes: float, users: int, counts: dict[str, Any], own: Growth, workers: Growth, stored: int
) -> str:
    """The answers to the requests, and the memory of the service and its workers."""
    answers = Counter[str]()
    for row in counts["rows"]:
        answers.update(row["statuses"])
    failed = sum(count for status, count in answers.items() if status >= "500" and status != "503")
    lines = [
        f"{minutes:g} minutes, {users} clients, {stored} shapes at the end. {answers.total()} requests: "
        f"{answers['503']} answered 503 with Retry-After while the queue was full, {failed} with another "
        f"5xx, {sum(counts['broken'].values())} otherwise than they must be.",
        "",
        "| request | answers | median ms | 95 % ms |",
        "|---|---|---:|---:|",
    ]
    for row in counts["rows"]:
        each = ", ".join(f"{status}: {count}" for status, count in sorted(row["statuses"].items()))
        lines.append(f"| {row['request']} | {each} | {row['median']:.0f} | {row['p95']:.0f} |")
    lines += [
        "",
        "| memory, MiB | after warm-up | at the end | most | a minute |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, growth in (("service", own), ("workers", workers)):
        lines.append(
            f"| {name} | {growth.first:.0f} | {growth.last:.0f} | {growth.most:.0f} | {growth.slope:+.2f} |"
        )
    return "\n".join(lines)


def grown(name: str, growth: Growth) -> list[str]:
    """Faults of the growth of memory: faster than `MOST_SLOPE`, and by more than `MOST_GROWTH` in all."""
    more = growth.last - growth.first
    wrong = growth.slope > MOST_SLOPE and more > MOST_GROWTH
    return [f"{name}: {growth.slope:.2f} MiB a minute, {more:.0f} MiB in all"] if wrong else []


if __name__ == "__main__":
    sys.exit(main())
