"""`python -m tests.soak.likeness`: the likeness of 200 pairs made by code, by a running service.

Exits with status 1 if fewer than 95 % of the pairs get a right likeness, or a copy gets a wrong scale.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path
from statistics import median
from typing import Any

from core.io import write_mesh
from tests.service.support import Running, serving, settings_in
from tests.soak.likeness.planted import KINDS, PlantedPair, planted_pairs

SHARES = dict.fromkeys(KINDS, 30) | {"mirrored": 20}
LIKENESSES = ("same", "scaled", "mirrored", "pose", "similar", "weak")
RIGHT = 0.95
SCALE = 0.02
"""Largest relative error of a scale; the scale of a coarse mesh is less exact."""


def compared(running: Running, pair: PlantedPair) -> dict[str, Any]:
    """The answer of POST /compare to a pair, without the correspondence."""
    ids = [
        running.store(write_mesh(mesh, "off"), f"{pair.kind} {pair.name} {number}.off")["id"]
        for number, mesh in enumerate((pair.first, pair.second))
    ]
    answer = running.client.post("/compare", json={"first": ids[0], "second": ids[1]})
    answer.raise_for_status()
    return {name: value for name, value in answer.json().items() if name != "correspondence"}


def main(seed: int, each: int | None) -> bool:
    """Print the confusion table; whether enough pairs are right."""
    shares = SHARES if each is None else dict.fromkeys(KINDS, each)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    wrong, wrong_scales, right = [], [], 0
    times: dict[str, list[float]] = {kind: [] for kind in KINDS}
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(settings_in(Path(folder), database_url=f"sqlite:///{folder}/archive.sqlite3")) as running,
    ):
        for pair in planted_pairs(seed, shares):
            answer = compared(running, pair)
            told = answer["likeness"]
            counts[pair.kind][told] += 1
            times[pair.kind].append(answer["milliseconds"]["likeness"])
            right += told in pair.right
            if told not in pair.right:
                wrong.append(f"{pair.kind}, {pair.name}: {told}, cc {answer['cc']:.4f}, "
                             f"combined {answer['combined']:.3f}")  # fmt: skip
            elif pair.scale is not None and abs(answer["scale"] / pair.scale - 1.0) > SCALE:
                wrong_scales.append(f"{pair.kind}, {pair.name}: scale {answer['scale']}, not {pair.scale}")
    total = sum(shares.values())
    print(f"{right} of {total} pairs have a right likeness.\n")
    print(f"| planted | pairs | {' | '.join(LIKENESSES)} | likeness, median ms |")
    print(f"|---|---:|{'---:|' * len(LIKENESSES)}---:|")
    for kind, found in counts.items():
        cells = " | ".join(str(found[each]) for each in LIKENESSES)
        print(f"| {kind} | {found.total()} | {cells} | {median(times[kind]):.1f} |")
    print()
    for line in wrong + wrong_scales:
        print(line)
    return right >= RIGHT * total and not wrong_scales


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.soak.likeness", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", type=int, help="pairs of each kind, instead of 200 in all")
    given = parser.parse_args()
    sys.exit(0 if main(given.seed, given.each) else 1)
