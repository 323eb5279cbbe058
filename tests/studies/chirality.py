"""Which of 60 parts made by code are mirror images, by a running service.

    python -m tests.studies.chirality DIR [--chiral 40] [--symmetric 20]

Each part is compared with itself turned and with its mirror image turned: of a chiral part the mirror image
is `mirrored`, all other pairs are `same`. Then the same with the second part on another mesh. Exits with
status 1 unless all pairs on the same mesh, and 110 of 120 on another, are right.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.random import Generator, default_rng

from core.gallery.solids import Frame, Part, box, ellipsoid, plate, revolved, tube
from core.gallery.surface import surface
from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.studies.common import run
from tests.studies.copies import moved
from tests.studies.planted import PlantedPair, compared, write_table

VERTICES, REMESHED = 2000, 2600
"""Approximate numbers of vertices of a part, and of its other mesh."""

LEAST_REMESHED = 110 / 120
"""Least share of right pairs on another mesh."""

Build = Callable[[Generator], list[Part]]


def bracket(rng: Generator) -> list[Part]:
    """Three bars of different lengths along three axes."""
    long, middle, short = rng.uniform(1.0, 1.3), rng.uniform(0.6, 0.8), rng.uniform(0.3, 0.45)
    bar = rng.uniform(0.14, 0.2)
    return [
        box(Frame().move(long / 2), (long, bar, bar), rounding=0.02, blend=0.01),
        box(Frame().move(0.0, middle / 2), (bar, middle, bar), rounding=0.02, blend=0.01),
        box(Frame().move(0.0, 0.0, short / 2), (bar, bar, short), rounding=0.02, blend=0.01),
    ]


def screw(rng: Generator) -> list[Part]:
    """A shaft with a head and a thread."""
    length, radius, turns = rng.uniform(1.2, 1.6), rng.uniform(0.15, 0.2), rng.uniform(2.5, 4.0)
    angles = np.linspace(0.0, 2.0 * np.pi * turns, int(14 * turns))
    hand = rng.choice((-1.0, 1.0))
    thread = np.stack(
        [
            radius * np.cos(angles),
            hand * radius * np.sin(angles),
            np.linspace(0.05, 0.85 * length, len(angles)),
        ],
        axis=1,
    )
    shaft = [(0.0, 0.0), (radius, 0.0), (radius, length), (0.0, length)]
    head = [(0.0, length), (2.2 * radius, length), (2.2 * radius, length + 0.15), (0.0, length + 0.15)]
    return [
        revolved(Frame(), shaft, 0.01, blend=0.01),
        revolved(Frame(), head, 0.02, blend=0.01),
        tube(thread, [0.07] * len(thread), blend=0.02),
    ]


def lever(rng: Generator) -> list[Part]:
    """A handle that is bent twice, in two planes, with a knob."""
    arm, rise, reach = rng.uniform(0.9, 1.2), rng.uniform(0.3, 0.5), rng.uniform(0.4, 0.6)
    joints = np.array([(0.0, 0.0, 0.0), (arm, 0.0, 0.0), (arm, rise, 0.0), (arm, rise, reach)])
    return [
        tube(joints, [0.13, 0.1, 0.09, 0.08], blend=0.03),
        ellipsoid(Frame().move(arm, rise, reach), (0.16, 0.16, 0.16), blend=0.03),
    ]


def shoe(rng: Generator) -> list[Part]:
    """A sole that is wider on one side, a toe and an ankle."""
    length, bulge = rng.uniform(1.0, 1.2), rng.uniform(0.14, 0.22)
    sole = [
        (0.0, -0.12),
        (0.35 * length, -0.1),
        (0.7 * length, -0.14),
        (length, 0.02),
        (0.85 * length, 0.12 + bulge),
        (0.35 * length, 0.1),
        (0.0, 0.12),
    ]
    toe = Frame().move(0.68 * length, 0.06, 0.12)
    return [
        plate(Frame(), sole, 0.12, blend=0.02),
        ellipsoid(toe, (0.3 * length, 0.16, 0.14), blend=0.05),
        tube(np.array([(0.12, 0.0, 0.0), (0.1, 0.0, 0.5)]), [0.15, 0.13], blend=0.08),
    ]


def yoke(rng: Generator) -> list[Part]:
    """A bar with two equal arms, and a knob on one side."""
    wide, high, bar = rng.uniform(0.9, 1.1), rng.uniform(0.6, 0.8), rng.uniform(0.14, 0.2)
    arms = [
        box(Frame().move(side * wide / 2, 0.0, high / 2), (bar, bar, high), rounding=0.02, blend=0.01)
        for side in (-1, 1)
    ]
    return [
        box(Frame(), (wide, bar, bar), rounding=0.02, blend=0.01),
        *arms,
        ellipsoid(Frame().move(0.0, 0.2), (0.15, 0.3, 0.15), blend=0.02),
    ]


def angle(rng: Generator) -> list[Part]:
    """Two bars of different lengths in a plane, with a knob."""
    long, short, bar = rng.uniform(1.0, 1.3), rng.uniform(0.5, 0.7), rng.uniform(0.14, 0.2)
    return [
        box(Frame().move(long / 2), (long, bar, bar), rounding=0.02, blend=0.01),
        box(Frame().move(0.0, short / 2), (bar, short, bar), rounding=0.02, blend=0.01),
        ellipsoid(Frame().move(long), (0.2, 0.16, 0.16), blend=0.02),
    ]


CHIRAL: tuple[Build, ...] = (bracket, screw, lever, shoe)
SYMMETRIC: tuple[Build, ...] = (yoke, angle)


def part(build: Build, number: int, vertices: int = VERTICES) -> Mesh:
    """One part; another number of vertices gives another mesh of the same part."""
    points, faces = surface(build(default_rng([number, len(build.__name__)])), vertices)
    return Mesh(points, faces)


def planted_pairs(chiral: int, symmetric: int, vertices: int) -> Iterator[PlantedPair]:
    """Yield each part with itself and with its mirror image, turned, with the second part on another mesh."""
    cases = [(build, number, True) for number in range(chiral // len(CHIRAL)) for build in CHIRAL]
    cases += [(build, number, False) for number in range(symmetric // len(SYMMETRIC)) for build in SYMMETRIC]
    for turn, (build, number, is_chiral) in enumerate(cases):
        first, other = part(build, number), part(build, number, vertices)
        for mirrored in (False, True):
            second = moved(other, turn, mirrored=mirrored)
            files = write_mesh(first, "off"), write_mesh(second, "off")
            kind = f"{'mirrored' if mirrored else 'turned'}, {'chiral' if is_chiral else 'symmetric'}"
            right = frozenset({"mirrored" if mirrored and is_chiral else "same"})
            yield PlantedPair(kind, f"{build.__name__} {number} {vertices}", files, right)


def main(folder: Path, chiral: int, symmetric: int) -> bool:
    """Write a table for each number of vertices; return whether enough pairs are right."""
    enough = True
    for vertices, least in ((VERTICES, 1.0), (REMESHED, LEAST_REMESHED)):
        answers = compared(planted_pairs(chiral, symmetric, vertices))
        write_table(folder / f"chirality-{vertices}.csv", answers)
        enough &= sum(answer.right for answer in answers) >= least * len(answers)
    return enough


if __name__ == "__main__":
    run(main, __doc__, chiral=40, symmetric=20)
