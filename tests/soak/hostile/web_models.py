"""`python -m tests.soak.hostile.web_models`: models of the web, and ten damaged copies of each, over HTTP.

The models are those of `webmodels` in the folder that ISOSHAPE_DATA names. Each model and copy is uploaded,
and one copy of each model searches among all models. Only 201 and refusals of the file are right, and the log
may have no warning of NumPy.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np

from core.io import read_mesh, write_mesh
from service.http.problem_document import TYPE_PREFIX
from tests.core.damaged import DAMAGES
from tests.soak.hostile.changed import REFUSALS
from tests.soak.hostile.serving import server

PLAIN = "as it is"


@dataclass
class Tally:
    """The answers, by damage and kind; the refusals one by one, and the faults."""

    answers: Counter[tuple[str, str]] = field(default_factory=Counter)
    refusals: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    queries: int = 0
    seconds: float = 0.0

    def add(self, model: str, damage: str, answer: httpx.Response) -> None:
        """Count the answer to an upload."""
        kind = "201"
        if answer.status_code not in {200, 201}:
            problem = answer.json()
            kind = f"{answer.status_code} {problem['type'].removeprefix(TYPE_PREFIX)}"
            self.refusals.append(f"{model}, {damage}: {kind}: {problem['detail']}")
            if answer.status_code != 422 or kind.split()[1] not in REFUSALS:
                self.faults.append(self.refusals[-1])
        self.answers[damage, kind] += 1

    def __str__(self) -> str:
        kinds = sorted({kind for _, kind in self.answers})
        rows = [
            f"| {name.replace('_', ' ')} |" + "".join(f" {self.answers[name, kind]} |" for kind in kinds)
            for name in (PLAIN, *DAMAGES)
        ]
        total = sum(self.answers.values())
        return "\n".join(
            [
                f"| model | {' | '.join(kinds)} |",
                f"|---|{'---:|' * len(kinds)}",
                *rows,
                "",
                f"{total} files and {self.queries} queries in {self.seconds:.0f} s; {len(self.refusals)} "
                f"refused, {len(self.faults)} faults: answers of 5xx, unexpected failures of the method, "
                "numerical warnings in the log.",
                *(f"* {refusal}" for refusal in self.refusals),
                *(f"* fault: {fault}" for fault in self.faults if fault not in self.refusals),
            ]
        )


def upload_models(client: httpx.Client, models: list[Path]) -> Tally:
    """Upload the models, which stay, and the damaged copies, which are deleted."""
    tally = Tally()
    start = time.perf_counter()
    for number, path in enumerate(models):
        rng = np.random.default_rng(number)
        data = path.read_bytes()
        tally.add(path.stem, PLAIN, client.post("/shapes", files={"file": (path.name, data)}))
        mesh = read_mesh(data, path.suffix[1:])
        copies = {name: write_mesh(damage(mesh, rng), "ply") for name, damage in DAMAGES.items()}
        for name, copy in copies.items():
            answer = client.post("/shapes", files={"file": (f"{path.stem} {name}.ply", copy)})
            tally.add(path.stem, name, answer)
            if answer.status_code == 201:
                client.delete(answer.headers["location"]).raise_for_status()
        name = list(copies)[number % len(copies)]
        answer = client.post(
            "/query", files={"file": ("copy.ply", copies[name])}, data={"rank_by": "combined"}
        )
        tally.queries += 1
        if answer.status_code not in {200, 422}:
            tally.faults.append(f"query with {path.stem}, {name}: {answer.status_code} {answer.text[:300]}")
        tally.seconds = time.perf_counter() - start
        if number % 20 == 0:
            print(f"{number + 1} of {len(models)} models, {tally.seconds:.0f} s", file=sys.stderr, flush=True)
    return tally


def main() -> int:
    """0 if nothing was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.hostile.web_models", description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="take every so many-th model only")
    arguments = parser.parse_args()
    folder = Path(os.environ["ISOSHAPE_DATA"]) / "webmodels"
    models = sorted(folder.glob("*.obj"))[:: arguments.every]
    if not models:
        parser.error(f"there are no models in {folder}")
    with tempfile.TemporaryDirectory() as scratch:
        with server(Path(scratch), ISOSHAPE_WORKERS="1", PYTHONWARNINGS="always::RuntimeWarning") as (
            _,
            client,
        ):
            tally = upload_models(client, models)
        log = (Path(scratch) / "log.txt").read_text()
    tally.faults += [line for line in log.splitlines() if "Warning" in line or '"level": "error"' in line]
    print(tally)
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
