"""`python -m tests.soak.duplicates.first_report --parts 300`: times of the report over parts made by code.

The parts are stored twice: by a service that seeks duplicates in the background, and by one that does not, so
that a request seeks them all. Exits with status 1 unless both reports are equal, and equal to the groups of
every pair by force (unless `--no-force`: the force takes minutes for 60 parts, and hours for 300).
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.service.support import Running, serving, settings_in
from tests.soak.duplicates.archive_of_parts import parts
from tests.soak.duplicates.force import groups_by_force

CLIENTS = 3
"""Uploads at a time."""


def complete(running: Running) -> dict[str, Any]:
    """The report when all shapes are judged."""
    while (answer := running.client.get("/duplicates").json())["unjudged"]:
        pass
    return dict(answer)


def store(running: Running, files: Iterable[tuple[str, bytes]]) -> None:
    """Upload files, several at a time."""
    with ThreadPoolExecutor(CLIENTS) as threads:
        for _ in threads.map(lambda file: running.store(file[1], file[0]), files):
            pass


def by(answer: dict[str, Any], field: str) -> set[frozenset[str]]:
    """The groups, by a field of their shapes."""
    return {frozenset(one["shape"][field] for one in group) for group in answer["groups"]}


def main(count: int, workers: int, *, force: bool) -> bool:
    """Print the times; whether the groups are right."""
    files = list(parts(count + 1))
    reports, right = [], True
    for background in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            settings = settings_in(Path(folder), workers=workers, duplicates_in_background=background)
            with serving(settings) as running:
                begun = time.monotonic()
                store(running, files[:-1])
                stored = time.monotonic()
                report = complete(running)
                judged = time.monotonic()
                print(
                    f"{'with' if background else 'without'} the background task: {count} parts stored in "
                    f"{stored - begun:.1f} s, the first report {judged - stored:.1f} s later: "
                    f"{report['compared']} pairs compared, {report['aligned']} registered, "
                    f"{len(report['groups'])} groups"
                )
                reports.append(by(report, "name"))
                if force and background:
                    right = by(report, "id") == groups_by_force(running.container)[0]
                    print(f"equal to every pair by force: {right}")
                running.store(files[-1][1], files[-1][0])
                begun = time.monotonic()
                complete(running)
                print(f"the report after one more part: {1e3 * (time.monotonic() - begun):.0f} ms")
    print(f"both reports are equal: {reports[0] == reports[1]}")
    return right and reports[0] == reports[1]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.soak.duplicates.first_report", description=__doc__)
    parser.add_argument("--parts", dest="count", type=int, default=60)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-force", dest="force", action="store_false")
    sys.exit(0 if main(**vars(parser.parse_args())) else 1)
