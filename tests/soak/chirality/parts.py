"""Parts made by code: 40 that differ from their mirror images, and 20 that do not."""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator, default_rng

from core.gallery.solids import Frame, Part, box, ellipsoid, plate, revolved, tube
from core.gallery.surface import surface
from core.mesh.mesh import Mesh

VERTICES = 2000
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
