"""Likeness of pairs of shapes made by code, by a running service, and of all pairs of collections.

    python -m tests.studies.likeness DIR [--each 30] [--poses 100] [--chiral 40] [--symmetric 20]
        [--collection COLLECTION]

likeness.csv has 200 pairs of bodies. poses.csv has 100 bodies in two poses, on two meshes, and 100 pairs of
machine parts of one family, none of which is a pose. chirality.csv has 60 parts, each compared with itself
turned and with its mirror image turned, on the same mesh and on another: the mirror image of a chiral part is
`mirrored`, all others are `same`. Exits with status 1 unless 95 % of the bodies, of the poses and of the
machine parts get a right likeness, every copy a right scale, and all parts on the same mesh, and 110 of 120
on another, a right likeness. With a collection, collection.csv has the shares of its pairs that are poses,
similar or weak, where nothing is registered.
"""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from statistics import fmean

import numpy as np
from numpy.random import Generator, default_rng
from scipy.special import expit

from core.descriptors.facts import signed_volume
from core.gallery import CLASSES
from core.gallery.bodies import make_body
from core.gallery.solids import Frame, Part, box, ellipsoid, plate, revolved, tube
from core.gallery.surface import surface
from core.io import format_of, read_mesh, write_mesh
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.likeness import NEAR_ISOMETRIC, POSE_CC, SIMILAR, Likeness
from core.serialization import embedding_to_bytes
from service.evaluation.retrieval import collection_files, score_collection
from service.search.likeness import is_pose
from service.search.records import Surface
from tests.studies.common import run, write
from tests.studies.copies import copy, moved, on_other_mesh
from tests.studies.machine_parts import FAMILIES, Drawing
from tests.studies.machine_parts import part as machine_part
from tests.studies.planted import PlantedPair, compared, write_table

ARTICULATED = ("bird", "fish", "hand", "octopus", "person", "quadruped", "snake", "spider", "teddy")
"""Classes whose poses are far from rigid copies."""

FACTORS = (0.3, 1.5, 2.5, 25.4)
OTHER_MESH = (1800, 3500)
"""Approximate numbers of vertices of other meshes of a body, which has 2,500."""

VERTICES, REMESHED = 2000, 2600
"""Approximate numbers of vertices of a part, and of its other mesh."""

RIGHT, SCALE, RIGHT_REMESHED = 0.95, 0.02, 110 / 120
"""Least share of right pairs of bodies, largest relative error of a scale (that of a coarse mesh is less
exact), and least share of right pairs of parts on other meshes."""

DRAWINGS, TOLERANCE = 10, 0.05
"""Number of drawings, of which two are compared, and their chord tolerance in millimetres."""

RIGID: frozenset[Likeness] = frozenset({"same", "scaled", "mirrored", "variant", "similar", "weak"})
"""The right likenesses of two rigid parts."""

KINDS: dict[str, frozenset[Likeness]] = {
    "turned": frozenset({"same"}),
    "scaled": frozenset({"scaled"}),
    "remeshed": frozenset({"same"}),
    "mirrored": frozenset({"mirrored", "same"}),
    "posed": frozenset({"pose"}),
    "another individual": frozenset({"similar"}),
    "another class": frozenset({"weak"}),
}
"""Each kind of planted pair with the right likenesses; some bodies are their own mirror images."""


def planted_pairs(seed: int, each: int) -> Iterator[PlantedPair]:
    """Yield pairs of each kind, of bodies that no other pair has; another seed gives other bodies."""
    body = 1000 * seed
    for kind in KINDS:
        labels = ARTICULATED if kind == "posed" else CLASSES
        for number in range(min(each, 20) if kind == "mirrored" else each):
            yield planted(kind, labels[number % len(labels)], body)
            body += 1


def planted(kind: str, label: str, body: int) -> PlantedPair:
    """Return one pair: a body of a class, and a copy, another pose, individual or class."""
    first = make_body(label, body).posed(0)
    other_mesh, scale, name = OTHER_MESH[body % 2], 1.0, f"{label}-{body}"
    match kind:
        case "turned":
            second = moved(first, body)
        case "scaled":
            scale = FACTORS[body % len(FACTORS)]
            second = moved(first, body, scale=scale)
        case "remeshed":
            how = ("split", "simplified", "other mesh")[body % 3]
            name = f"{name}, {how}"
            if how == "other mesh":
                first = make_body(label, body).rest
                second = moved(make_body(label, body, vertices=other_mesh).rest, body)
            else:
                second = copy(first, how, body)
        case "mirrored":
            second = moved(first, body, mirrored=True)
        case "posed":
            # At another resolution, fins of a body vanish and its fingers fuse: that is no pose of it.
            second = moved(on_other_mesh(make_body(label, body).posed(1), other_mesh), body)
        case "another individual":
            second = make_body(label, body + 500, vertices=other_mesh).posed(1)
        case _:
            step = 1 + body % (len(CLASSES) - 1)
            other = CLASSES[(CLASSES.index(label) + step) % len(CLASSES)]
            name, second = f"{label} {other} {body}", make_body(other, body).posed(1)
    files = write_mesh(first, "off"), write_mesh(second, "off")
    known_scale = scale if kind in {"turned", "scaled", "remeshed"} else None
    return PlantedPair(kind, name, files, KINDS[kind], known_scale)


def likenesses(collection: Path, workers: int | None) -> list[dict[str, object]]:
    """Return the shares of pairs of one class and of two that are poses, similar or weak."""
    files = collection_files(collection, None)
    labels, scores = score_collection(files, DEFAULT, workers)
    classes, paths = np.array(labels), [path for path, _ in files]
    once = np.triu(np.ones_like(scores.cc, dtype=bool), 1)
    pipeline = Pipeline()

    @cache
    def surface_of(number: int) -> Surface:
        mesh = read_mesh(paths[number].read_bytes(), format_of(paths[number].name))
        return Surface(embedding_to_bytes(pipeline.embed(mesh)))

    pose = np.zeros_like(once)
    near = once & (scores.differences.spectral <= NEAR_ISOMETRIC) & (scores.cc >= POSE_CC)
    for i, j in np.argwhere(near):
        pose[i, j] = is_pose(surface_of(i), surface_of(j), DEFAULT, scores.cc[i, j])
    similar = ~pose & (expit(scores.combined) >= SIMILAR)
    one_class = classes[:, None] == classes[None, :]
    return [
        {"collection": collection.name, "pairs_of": kind, "pairs": int(chosen.sum())}
        | {name: share[chosen].mean() for name, share in shares.items()}
        for shares in ({"pose": pose, "similar": similar, "weak": ~pose & ~similar},)
        for kind, chosen in (("one class", once & one_class), ("two classes", once & ~one_class))
    ]


def bracket(rng: Generator) -> list[Part]:
    """Return three bars of different lengths along three axes."""
    long, middle, short = rng.uniform((1.0, 0.6, 0.3), (1.3, 0.8, 0.45))
    bar = rng.uniform(0.14, 0.2)
    sizes = ((long, bar, bar), (bar, middle, bar), (bar, bar, short))
    places = ((long / 2, 0.0, 0.0), (0.0, middle / 2, 0.0), (0.0, 0.0, short / 2))
    return [
        box(Frame().move(*place), size, rounding=0.02, blend=0.01)
        for place, size in zip(places, sizes, strict=True)
    ]


def screw(rng: Generator) -> list[Part]:
    """Return a shaft with a head and a thread."""
    length, radius, turns = rng.uniform((1.2, 0.15, 2.5), (1.6, 0.2, 4.0))
    angles = np.linspace(0.0, 2.0 * np.pi * turns, int(14 * turns))
    circle = np.cos(angles), rng.choice((-1.0, 1.0)) * np.sin(angles)
    thread = np.stack(
        [*(radius * axis for axis in circle), np.linspace(0.05, 0.85 * length, len(angles))], axis=1
    )
    profiles = [
        [(0.0, low), (wide, low), (wide, high), (0.0, high)]
        for low, high, wide in ((0.0, length, radius), (length, length + 0.15, 2.2 * radius))
    ]
    return [
        revolved(Frame(), profiles[0], 0.01, blend=0.01),
        revolved(Frame(), profiles[1], 0.02, blend=0.01),
        tube(thread, [0.07] * len(thread), blend=0.02),
    ]


def lever(rng: Generator) -> list[Part]:
    """Return a handle that is bent twice, in two planes, with a knob."""
    arm, rise, reach = rng.uniform((0.9, 0.3, 0.4), (1.2, 0.5, 0.6))
    joints = np.array([(0.0, 0.0, 0.0), (arm, 0.0, 0.0), (arm, rise, 0.0), (arm, rise, reach)])
    knob = ellipsoid(Frame().move(arm, rise, reach), (0.16, 0.16, 0.16), blend=0.03)
    return [tube(joints, [0.13, 0.1, 0.09, 0.08], blend=0.03), knob]


def shoe(rng: Generator) -> list[Part]:
    """Return a sole that is wider on one side, a toe and an ankle."""
    length, bulge = rng.uniform((1.0, 0.14), (1.2, 0.22))
    sole = [(0.0, -0.12), (0.35 * length, -0.1), (0.7 * length, -0.14), (length, 0.02)]
    sole += [(0.85 * length, 0.12 + bulge), (0.35 * length, 0.1), (0.0, 0.12)]
    return [
        plate(Frame(), sole, 0.12, blend=0.02),
        ellipsoid(Frame().move(0.68 * length, 0.06, 0.12), (0.3 * length, 0.16, 0.14), blend=0.05),
        tube(np.array([(0.12, 0.0, 0.0), (0.1, 0.0, 0.5)]), [0.15, 0.13], blend=0.08),
    ]


def yoke(rng: Generator) -> list[Part]:
    """Return a bar with two equal arms, and a knob on one side."""
    wide, high, bar = rng.uniform((0.9, 0.6, 0.14), (1.1, 0.8, 0.2))
    bars = [(Frame(), (wide, bar, bar))]
    bars += [(Frame().move(side * wide / 2, 0.0, high / 2), (bar, bar, high)) for side in (-1, 1)]
    knob = ellipsoid(Frame().move(0.0, 0.2), (0.15, 0.3, 0.15), blend=0.02)
    return [*(box(frame, size, rounding=0.02, blend=0.01) for frame, size in bars), knob]


def angle(rng: Generator) -> list[Part]:
    """Return two bars of different lengths in a plane, with a knob."""
    long, short, bar = rng.uniform((1.0, 0.5, 0.14), (1.3, 0.7, 0.2))
    bars = [(Frame().move(long / 2), (long, bar, bar)), (Frame().move(0.0, short / 2), (bar, short, bar))]
    knob = ellipsoid(Frame().move(long), (0.2, 0.16, 0.16), blend=0.02)
    return [*(box(frame, size, rounding=0.02, blend=0.01) for frame, size in bars), knob]


def posed_and_rigid(seed: int, count: int) -> Iterator[PlantedPair]:
    """Yield bodies in two poses, and machine parts with the most similar of other drawings."""
    for number in range(count):
        yield planted("posed", ARTICULATED[number % len(ARTICULATED)], 1000 * seed + 20_000 + number)
    families = tuple(FAMILIES)
    for number in range(count):
        family = families[number % len(families)]
        start = 10_000 * seed + 20_000 + DRAWINGS * number
        drawings = (Drawing(start + each, TOLERANCE) for each in range(DRAWINGS))
        first, *others = (machine_part(family, drawing) for drawing in drawings)
        nearest = min(others, key=lambda mesh: abs(compactness(mesh) - compactness(first)))
        files = write_mesh(first, "off"), write_mesh(moved(nearest, number), "off")
        yield PlantedPair("another drawing", f"{family}-{number}", files, RIGID)


def compactness(mesh: Mesh) -> float:
    """Return the volume of a closed mesh over its area to the power 3/2."""
    areas = face_areas(mesh.vertices, mesh.faces).sum()
    return float(abs(signed_volume(mesh.vertices, mesh.faces)) / areas**1.5)


Build = Callable[[Generator], list[Part]]
CHIRAL: tuple[Build, ...] = (bracket, screw, lever, shoe)
SYMMETRIC: tuple[Build, ...] = (yoke, angle)


def part(build: Build, number: int, vertices: int = VERTICES) -> Mesh:
    """Return one part; another number of vertices gives another mesh of the same part."""
    return Mesh(*surface(build(default_rng([number, len(build.__name__)])), vertices))


def chiral_pairs(chiral: int, symmetric: int, vertices: int) -> Iterator[PlantedPair]:
    """Yield each part with itself and with its mirror image, turned, with the second part on another mesh."""
    cases = [(build, number, True) for number in range(chiral // len(CHIRAL)) for build in CHIRAL]
    cases += [(build, number, False) for number in range(symmetric // len(SYMMETRIC)) for build in SYMMETRIC]
    for turn, (build, number, is_chiral) in enumerate(cases):
        for mirrored in (False, True):
            second = moved(part(build, number, vertices), turn, mirrored=mirrored)
            files = write_mesh(part(build, number), "off"), write_mesh(second, "off")
            kinds = "mirrored" if mirrored else "turned", "chiral" if is_chiral else "symmetric"
            kind = ", ".join(kinds if vertices == VERTICES else (*kinds, "remeshed"))
            right: Likeness = "mirrored" if mirrored and is_chiral else "same"
            yield PlantedPair(kind, f"{build.__name__} {number}", files, frozenset({right}))


def main(
    folder: Path,
    seed: int,
    each: int,
    poses: int,
    chiral: int,
    symmetric: int,
    collection: Path | None,
    workers: int | None,
) -> bool:
    """Write all tables; return whether enough pairs are right, and every scale."""
    if collection is not None:
        write(folder / "collection.csv", likenesses(collection, workers))
    answers = compared(planted_pairs(seed, each))
    write_table(folder / "likeness.csv", answers)
    bent = compared(posed_and_rigid(seed, poses))
    write_table(folder / "poses.csv", bent)
    posed, rigid = bent[:poses], bent[poses:]
    parts = [compared(chiral_pairs(chiral, symmetric, vertices)) for vertices in (VERTICES, REMESHED)]
    write_table(folder / "chirality.csv", [*parts[0], *parts[1]])
    shares = [fmean(answer.right for answer in group) for group in (answers, posed, rigid, *parts)]
    kinds = "bodies, poses, machine parts, parts and remeshed parts"
    print(f"Right likenesses of {kinds}:", *(f"{share:.1%}" for share in shares))
    # One of few poses, and one of few machine parts, may be wrong.
    few = min(RIGHT, 1.0 - 1.0 / poses)
    bounds = zip(shares, (RIGHT, few, few, 1.0, RIGHT_REMESHED), strict=True)
    return all(share >= least for share, least in bounds) and all(answer.error <= SCALE for answer in answers)


if __name__ == "__main__":
    run(main, __doc__, seed=0, each=30, poses=100, chiral=40, symmetric=20, collection=Path, workers=int)
