"""Recall and precision of planted copies among poses, by the report on duplicates.

    python -m tests.studies.duplicates DIR [--poses 8] [--seed 0]

The gallery holds poses of one body of every class, which differ by pose alone; where the body is stiff, as a
cup, other individuals. And it holds people, several poses of each, every one meshed anew. Forty of these
shapes are stored again as copies under other names: turned, scaled, split, simplified and mirrored. Exits
with status 1 unless all copies are found, and nothing else.
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from core.gallery import CLASSES
from core.gallery.bodies import make_body
from core.io import write_mesh
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.registration.similarity import best_similarity
from tests.people import make_person
from tests.service.support import serving, settings_in
from tests.studies.common import run, write
from tests.studies.copies import KINDS, copy

Pair = tuple[str, str]

PLANTED = 40
PEOPLE = 4

DIFFERENT = 0.01
"""Poses lie farther apart than this, over the root of the area: some draws differ by one degree."""


def poses_of(label: str, poses: int) -> list[Mesh]:
    """Return poses that differ, of one body; other individuals where few of its poses do."""
    body = make_body(label)
    made: list[Mesh] = []
    for pose in range(2 * poses):
        mesh = body.posed(pose)
        if len(made) < poses and all(apart(mesh, other) > DIFFERENT for other in made):
            made.append(mesh)
    return made if len(made) == poses else [make_body(label, pose).posed(pose) for pose in range(poses)]


def apart(first: Mesh, second: Mesh) -> float:
    """Return the distance of two poses of one mesh after the best similarity, over the root of the area."""
    motion = best_similarity(first.vertices, second.vertices, sign=1, scaled=True)
    squares = ((second.vertices - motion.apply(first.vertices)) ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean() / face_areas(second.vertices, second.faces).sum()))


def gallery(poses: int) -> dict[str, Mesh]:
    """Return the named shapes among which copies are planted."""
    shapes = {
        f"{label}-{pose}": mesh for label in CLASSES for pose, mesh in enumerate(poses_of(label, poses))
    }
    people = {f"people-{body}-{pose}": make_person(body, pose) for body in range(PEOPLE) for pose in range(4)}
    return shapes | people


def main(folder: Path, poses: int, seed: int) -> bool:
    """Write duplicates.csv; return whether the report has all copies, and nothing else."""
    shapes = gallery(poses)
    names = sorted(shapes)
    chosen = [names[place] for place in np.random.default_rng(seed).permutation(len(names))[:PLANTED]]
    planted = {}
    with TemporaryDirectory() as scratch, serving(settings_in(Path(scratch))) as running:
        for name, mesh in shapes.items():
            running.store(write_mesh(mesh, "off"), f"{name}.off")
        for number, name in enumerate(chosen):
            kind = KINDS[number % len(KINDS)]
            planted[f"{name}.off", f"copy-{number}.off"] = kind
            running.store(write_mesh(copy(shapes[name], kind, number), "off"), f"copy-{number}.off")
        begun = time.monotonic()
        while (answer := running.client.get("/duplicates").json())["unjudged"]:
            pass
        seconds = time.monotonic() - begun
    reported = {
        (group[0]["shape"]["name"], member["shape"]["name"]): member
        for group in answer["groups"]
        for member in group[1:]
    }
    print(
        f"{answer['shapes']} shapes: {answer['compared']:,} pairs compared, {answer['aligned']:,} registered "
        f"in {seconds:.1f} s"
    )
    write(folder / "duplicates.csv", [row(kind, planted, reported) for kind in KINDS])
    for pair in sorted(set(reported) - set(planted)):
        print(f"{' and '.join(pair)} are no copies: residual {reported[pair]['residual']:.4f}")
    for first, second in sorted(set(planted) - set(reported)):
        print(f"{second}, a copy of {first}, was not found")
    return set(reported) == set(planted)


def row(kind: str, planted: dict[Pair, str], reported: dict[Pair, Any]) -> dict[str, Any]:
    """Return how many copies of a kind were planted and found, and what is told of them."""
    pairs = [pair for pair, how in planted.items() if how == kind]
    members = [reported[pair] for pair in pairs if pair in reported]
    counts = {"planted": kind, "copies": len(pairs), "found": len(members)}
    for likeness in ("same", "scaled", "mirrored"):
        counts[likeness] = sum(member["likeness"] == likeness for member in members)
    residual = max((member["residual"] for member in members), default=float("nan"))
    return counts | {
        "largest_residual": residual,
        "least_cc": min((member["cc"] for member in members), default=float("nan")),
    }


if __name__ == "__main__":
    run(main, __doc__, poses=8, seed=0)
