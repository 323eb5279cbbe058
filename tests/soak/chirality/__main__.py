"""`python -m tests.soak.chirality`: which parts are mirror images, by a running service.

40 chiral and 20 symmetric parts made by code, each compared with itself turned and with its mirror image
turned: 120 pairs. Of a chiral part the mirror image is `mirrored`; all other pairs are `same`. Then the same
with the second part on another mesh. Exits with status 1 unless all of the first 120 pairs, and 110 of the
second, are right.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from core.io import write_mesh
from tests.service.support import Running, serving, settings_in
from tests.soak.chirality.parts import CHIRAL, SYMMETRIC, VERTICES, part
from tests.soak.duplicates.copies import moved

REMESHED = 2600
"""Approximate number of vertices of the other mesh."""

LEAST_REMESHED = 110 / 120


def likeness(running: Running, ids: tuple[str, str]) -> str:
    """The likeness of two stored shapes."""
    answer = running.client.post("/compare", json={"first": ids[0], "second": ids[1]})
    answer.raise_for_status()
    return str(answer.json()["likeness"])


def main(chiral: int, symmetric: int) -> bool:
    """Print the numbers of right pairs; whether enough are right."""
    enough = True
    cases = [(build, number, True) for number in range(chiral // len(CHIRAL)) for build in CHIRAL]
    cases += [(build, number, False) for number in range(symmetric // len(SYMMETRIC)) for build in SYMMETRIC]
    with tempfile.TemporaryDirectory() as folder, serving(settings_in(Path(folder))) as running:
        for vertices, least in ((VERTICES, 1.0), (REMESHED, LEAST_REMESHED)):
            right = 0
            for turn, (build, number, is_chiral) in enumerate(cases):
                first, other = part(build, number), part(build, number, vertices)
                name = f"{build.__name__} {number} {vertices}"
                one = running.store(write_mesh(first, "off"), f"{name}.off")["id"]
                for mirrored in (False, True):
                    copy = moved(other, turn, mirrored=mirrored)
                    two = running.store(write_mesh(copy, "off"), f"{name} {mirrored}.off")["id"]
                    told = likeness(running, (one, two))
                    expected = "mirrored" if mirrored and is_chiral else "same"
                    right += told == expected
                    if told != expected:
                        print(f"{name}: {told}, not {expected}", flush=True)
            kind = "the same mesh" if vertices == VERTICES else "another mesh"
            print(f"{right} of {2 * len(cases)} pairs on {kind} are right.", flush=True)
            enough &= right >= least * 2 * len(cases)
    return enough


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.soak.chirality", description=__doc__)
    parser.add_argument("--chiral", type=int, default=40)
    parser.add_argument("--symmetric", type=int, default=20)
    given = parser.parse_args()
    sys.exit(0 if main(given.chiral, given.symmetric) else 1)
