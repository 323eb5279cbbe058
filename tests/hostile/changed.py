"""`python -m tests.hostile.changed`: upload changed files to a service, and look at what it has taken.

Every answer must be 201 or a refusal of the file by name of its cause. What is stored must have finite
numbers, and indices that refer to something.
"""

import argparse
import io
import math
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import httpx
import numpy as np

from service.problems import MEDIA_TYPE, TYPE_PREFIX
from tests.hostile.mutation import mutations
from tests.hostile.serving import server

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
    """What came of the uploads: answers counted, what was wrong, and the longest wait in seconds."""

    answers: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    worst: float = 0.0
    seconds: float = 0.0

    def __str__(self) -> str:
        total = sum(self.answers.values())
        answers = ", ".join(f"{answer} {count}" for answer, count in self.answers.most_common())
        return (
            f"{total} changed files in {self.seconds:.0f} s, the worst {self.worst:.1f} s: {answers}; "
            f"{len(self.faults)} faults"
        )


def upload_changed(client: httpx.Client, count: int, seed: int, seconds: float = math.inf) -> Tally:
    """Upload so many changed files, four at a time; what is stored is looked at, and deleted.

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
            return "none", "no answer in time", time.perf_counter() - start
        return *_judged(client, answer), time.perf_counter() - start

    with ThreadPoolExecutor(AT_A_TIME) as threads:
        changed = enumerate(islice(mutations(seed), count))
        # Some at a time: a map takes all that it is given at once.
        while tally.seconds < seconds and (batch := list(islice(changed, 64))):
            for (number, _), (name, fault, took) in zip(batch, threads.map(one, batch), strict=True):
                tally.answers[name] += 1
                tally.worst = max(tally.worst, took)
                if fault:
                    tally.faults.append(f"seed {seed}, file {number}: {fault}")
            tally.seconds = time.perf_counter() - began
    return tally


def _judged(client: httpx.Client, answer: httpx.Response) -> tuple[str, str]:
    """A name for the answer, and what is wrong with it or with what was stored; "" if nothing is."""
    if answer.status_code == 201:
        address = answer.headers["location"]
        arrays = client.get(f"{address}/embedding", params={"format": "npz"})
        fault = fault_in(answer.json()["facts"], arrays.content)
        assert client.delete(address).status_code == 204
        return "stored", fault
    if answer.headers.get("content-type") != MEDIA_TYPE:
        return str(answer.status_code), f"{answer.status_code} without a problem document"
    problem = answer.json()
    kind = problem["type"].removeprefix(TYPE_PREFIX)
    wrong = answer.status_code != 422 or kind not in REFUSALS
    return kind, f"{answer.status_code} {kind}: {problem['detail']}" if wrong else ""


def fault_in(facts: dict[str, float], npz: bytes) -> str:
    """What is wrong with a stored shape, by its facts and the arrays of its embedding; "" if nothing is."""
    if not all(np.isfinite(value) and value >= 0 for value in facts.values()):
        return f"facts {facts}"
    if not (facts["area"] > 0 and facts["scale"] > 0 and facts["faces"] >= 1 and facts["vertices"] >= 3):
        return f"no surface: {facts}"
    with np.load(io.BytesIO(npz), allow_pickle=False) as arrays:
        found = dict(arrays)
    for name, array in found.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return f"{name} holds a number that is not finite"
    samples = len(found["positions"])
    bounds = dict.fromkeys(("graph_edges", "tree_edges", "regions"), samples)
    for name, bound in {**bounds, "vertices": facts["vertices"]}.items():
        if found[name].size and not (found[name].min() >= 0 and found[name].max() < bound):
            return f"{name} holds an index outside 0 .. {bound} - 1"
    lengths = (samples, len(found["vertices"]), len(found["tree_edges"]) + 1)
    if samples == 0 or len(set(lengths)) > 1:
        return f"samples, vertices and edges of the tree do not fit together: {lengths}"
    return ""


def main() -> int:
    """0 if nothing was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.changed", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="how many files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=math.inf, help="when to end with what there is")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as (_, client):
        tally = upload_changed(client, arguments.count, arguments.seed, arguments.seconds)
        remaining = client.get("/shapes").json()["total"]
    print(tally)
    for fault in tally.faults:
        print(fault)
    return 1 if tally.faults or remaining else 0


if __name__ == "__main__":
    sys.exit(main())
