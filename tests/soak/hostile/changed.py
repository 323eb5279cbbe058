"""`python -m tests.soak.hostile.changed`: upload changed files to a service, and look at what it has taken.

Every answer must be 201 or a refusal of the file by name of its cause. What was stored is read back: its mesh
and its embedding must have finite numbers, and indices that refer to something; `isoshape check` of the
archive must find nothing.
"""

import argparse
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import httpx

from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX
from service.storage.checking import check
from tests.soak.hostile.mutation import mutations
from tests.soak.hostile.serving import server
from tests.soak.hostile.stored import fault_in_embedding, fault_in_mesh, other_format

REFUSALS = {
    "empty-file",
    "malformed-mesh",
    "non-finite-coordinates",
    "no-triangles",
    "degenerate-mesh",
    "mesh-too-complex",
    "external-reference",
    "file-time-limit",
}
AT_A_TIME = 4


@dataclass
class Tally:
    """The outcome of the uploads.

    Attributes
    ----------
    answers : Counter
        By format and answer: "stored", or the kind of problem.
    faults : list of str
    worst, seconds : float
        The longest wait, and how long all took.
    """

    answers: Counter[tuple[str, str]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    worst: float = 0.0
    seconds: float = 0.0

    def count(self, answer: str) -> int:
        """The number of files of any format that had an answer."""
        return sum(count for (_, each), count in self.answers.items() if each == answer)

    def __str__(self) -> str:
        formats = sorted({format for format, _ in self.answers})
        kinds = sorted({answer for _, answer in self.answers}, key=lambda answer: -self.count(answer))
        lines = [
            f"| answer | {' | '.join(formats)} | all |",
            f"|---|{'---:|' * (len(formats) + 1)}",
            *(
                f"| {'201' if kind == 'stored' else f'422 {kind}' if kind in REFUSALS else kind} | "
                + " | ".join(str(self.answers[format, kind]) for format in formats)
                + f" | {self.count(kind)} |"
                for kind in kinds
            ),
            "",
            f"{sum(self.answers.values())} changed files in {self.seconds:.0f} s, the worst {self.worst:.1f} "
            f"s; {self.count('stored')} stored and read back; {len(self.faults)} faults.",
            *(f"* {fault}" for fault in self.faults),
        ]
        return "\n".join(lines)


def upload_changed(client: httpx.Client, count: int, seed: int, seconds: float = math.inf) -> Tally:
    """Upload so many changed files, four at a time, and read back what is stored, which stays there.

    It ends early, with what it has, when so many seconds are over.
    """
    tally = Tally()
    began = time.perf_counter()

    def one(numbered: tuple[int, tuple[str, bytes]]) -> tuple[str, str, float]:
        number, (format, data) = numbered
        start = time.perf_counter()
        try:
            answer = client.post("/shapes", files={"file": (f"{number}.{format}", data)})
        except httpx.TimeoutException:
            return "no answer in time", "no answer in time", time.perf_counter() - start
        took = time.perf_counter() - start
        return *_judged(client, format, answer), took

    with ThreadPoolExecutor(AT_A_TIME) as threads:
        changed = enumerate(islice(mutations(seed), count))
        # Some at a time: a map takes all that it is given at once.
        while tally.seconds < seconds and (batch := list(islice(changed, 64))):
            for (number, (format, _)), (name, fault, took) in zip(
                batch, threads.map(one, batch), strict=True
            ):
                tally.answers[format, name] += 1
                tally.worst = max(tally.worst, took)
                if fault:
                    tally.faults.append(f"seed {seed}, file {number}: {fault}")
            tally.seconds = time.perf_counter() - began
    return tally


def _judged(client: httpx.Client, format: str, answer: httpx.Response) -> tuple[str, str]:
    """A name for the answer, and what is wrong with it or with what was stored; "" if nothing is."""
    if answer.status_code == 201:
        facts, address = answer.json()["facts"], answer.headers["location"]
        npz = client.get(f"{address}/embedding", params={"format": "npz"}).content
        other = other_format(format)
        mesh = client.get(f"{address}/file", params={"format": other}).content
        return "stored", fault_in_embedding(facts, npz) or fault_in_mesh(facts, mesh, other)
    if answer.headers.get("content-type") != MEDIA_TYPE:
        return str(answer.status_code), f"{answer.status_code} without a problem document"
    problem = answer.json()
    kind = problem["type"].removeprefix(TYPE_PREFIX)
    wrong = answer.status_code != 422 or kind not in REFUSALS
    return kind, f"{answer.status_code} {kind}: {problem['detail']}" if wrong else ""


def faults_of_archive(path: Path, tally: Tally) -> Iterator[str]:
    """The faults that `isoshape check` finds, and whether the archive has as many shapes as were stored."""
    report = check(path, lock_seconds=10)
    yield from (f"isoshape check: {fault}" for fault in report.faults)
    if report.shapes != tally.count("stored"):
        yield f"{tally.count('stored')} were stored, and the archive has {report.shapes}"


def main() -> int:
    """0 if nothing was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.hostile.changed", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="how many files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=math.inf, help="when to end with what there is")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as (_, client):
        tally = upload_changed(client, arguments.count, arguments.seed, arguments.seconds)
        tally.faults += faults_of_archive(Path(folder) / "archive.sqlite3", tally)
    print(tally)
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
