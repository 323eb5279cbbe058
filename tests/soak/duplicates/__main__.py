"""`python -m tests.soak.duplicates --poses 8`: recall and precision of planted copies.

The gallery holds poses of one body of every class, which differ by pose alone; where the body is stiff, as a
cup, other individuals. And it holds people, several poses of each, every one meshed anew. Forty of these
shapes are stored again as copies under other names: turned, scaled, split, simplified and mirrored.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
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
from tests.soak.duplicates.copies import KINDS, copy

PLANTED = 40
PEOPLE = 4

DIFFERENT = 0.01
"""Poses lie farther apart than this, over the root of the area: some draws differ by one degree."""


def poses_of(label: str, poses: int) -> list[Mesh]:
    """Poses that differ, of one body; other individuals where few of its poses do."""
    body = make_body(label)
    made: list[Mesh] = []
    for pose in range(2 * poses):
        mesh = body.posed(pose)
        if len(made) < poses and all(apart(mesh, other) > DIFFERENT for other in made):
            made.append(mesh)
    return made if len(made) == poses else [make_body(label, pose).posed(pose) for pose in range(poses)]


def apart(one: Mesh, other: Mesh) -> float:
    """How far apart two poses lie after the best similarity: vertex i of one is vertex i of the other."""
    motion = best_similarity(one.vertices, other.vertices, sign=1, scaled=True)
    squares = ((other.vertices - motion.apply(one.vertices)) ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean() / face_areas(other.vertices, other.faces).sum()))


def gallery(poses: int) -> dict[str, Mesh]:
    shapes = {
        f"{label}-{pose}": mesh for label in CLASSES for pose, mesh in enumerate(poses_of(label, poses))
    }
    people = {f"people-{body}-{pose}": make_person(body, pose) for body in range(PEOPLE) for pose in range(4)}
    return shapes | people


def main(poses: int, seed: int) -> bool:
    """Whether all copies were found, and nothing else was taken for one."""
    shapes = gallery(poses)
    names = sorted(shapes)
    chosen = [names[place] for place in np.random.default_rng(seed).permutation(len(names))[:PLANTED]]
    planted = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(settings_in(Path(folder), database_url=f"sqlite:///{folder}/archive.sqlite3")) as running,
    ):
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
    found = {
        (group[0]["shape"]["name"], one["shape"]["name"]): one
        for group in answer["groups"]
        for one in group[1:]
    }
    false = sorted(set(found) - set(planted))
    print(
        f"{answer['shapes']} shapes: {answer['compared']:,} pairs compared, {answer['aligned']:,} registered "
        f"in {seconds:.1f} s. {len(set(planted) & set(found))} of {len(planted)} copies found, "
        f"{len(false)} wrong pairs.\n"
    )
    print("| planted | copies | found | same | scaled | mirrored | largest residual | least cc |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for kind in KINDS:
        pairs = [pair for pair, made in planted.items() if made == kind]
        print(row(kind, len(pairs), [found[pair] for pair in pairs if pair in found]))
    for first, second in false:
        one = found[first, second]
        print(f"\n{first} and {second} are no copies: residual {one['residual']:.4f}, cc {one['cc']:.4f}")
    for first, second in sorted(set(planted) - set(found)):
        print(f"\n{second}, a copy of {first}, was not found")
    return set(found) == set(planted)


def row(kind: str, planted: int, found: list[dict[str, Any]]) -> str:
    told = [sum(one["likeness"] == each for one in found) for each in ("same", "scaled", "mirrored")]
    residual = max((one["residual"] for one in found), default=float("nan"))
    cc = min((one["cc"] for one in found), default=float("nan"))
    counts = " | ".join(map(str, (planted, len(found), *told)))
    return f"| {kind} | {counts} | {residual:.4f} | {cc:.4f} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    sys.exit(0 if main(**vars(parser.parse_args())) else 1)
