"""Likeness of over 400 pairs of machine parts made by code, by a running service.

    python -m tests.studies.kinship DIR [--seed 0] [--every 1]

Copies are turned, scaled, mirrored and remeshed; variants have a hole more, moved or larger, a fillet more,
or are longer. Exits with status 1 unless 98 % of the pairs have the right likeness, 98 % of the copies a
scale that is right to 1e-4, and 98 % of the pairs one likeness by /query, /compare and /duplicates; and if a
variant is a copy, a copy at the tolerance of the first a variant, or the scale of a part with planes wrong.
"""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from core.io import FORMATS, write_mesh
from core.mesh.mesh import Mesh
from core.ranking.likeness import Likeness
from tests.studies.common import run
from tests.studies.copies import decimated, moved, quartered
from tests.studies.machine_parts import (
    FAMILIES,
    LARGER,
    LONGER,
    Change,
    Drawing,
    Family,
    extruded,
    mesh_of,
    part,
)
from tests.studies.planted import PlantedPair, compared, write_table
from tests.studies.step_parts import step_prism

TOLERANCES = (0.02, 0.05, 0.1)
"""Chord tolerances in millimetres."""

CHIRAL: frozenset[Family] = frozenset({"bracket", "housing", "bolt", "tray"})
"""Families whose parts differ from their mirror images; prisms and bodies of revolution do not."""

COPIES = (
    "turned",
    "25.4",
    "1/3",
    "mirrored",
    "remeshed",
    "other tolerance",
    "finer",
    "quartered",
    "decimated",
)
SCALES = {"25.4": 25.4, "1/3": 1.0 / 3.0}
FINER = {"finer": 0.1, "decimated": 0.5}
"""Factor of the tolerance. A decimated part is a quartered one, and again as far from it as its tolerance."""

VARIANTS: tuple[Change, ...] = ("hole", "moved", "larger", "fillet", "longer")
PHASE = 0.37
"""Share of a segment by which the vertices of the circles of a remeshed part are turned."""


RIGHT = 0.98
"""Least share of right pairs, of right scales, and of pairs with one likeness in three answers; one may be
wrong."""

SCALE, ROUGH = 1e-4, 5e-4
"""Largest relative error of a scale, and that of the parts of `ROUND` and of decimated ones."""

ROUND: frozenset[Family] = frozenset({"eyebolt", "tray"})
"""Families with surfaces that bend in two directions."""

COPY = frozenset({"same", "scaled", "mirrored"})


def planted_pairs(seed: int) -> Iterator[PlantedPair]:
    """Yield 420 pairs as STL, and 24 with STEP if it can be read; another seed gives other dimensions."""
    number = 1000 * seed
    for tolerance in TOLERANCES:
        for family in FAMILIES:
            for kind in (*COPIES, *VARIANTS):
                number += 1
                yield _stl(family, kind, tolerance, number)
    if FORMATS["step"].is_read:
        for kind in ("turned", "25.4", "1/3", "mirrored", "hole", "moved", "larger", "longer") * 2:
            number += 1
            yield _step(kind, number)
        for tolerance in (*TOLERANCES, 0.2) * 2:
            number += 1
            yield _step("STL", number, tolerance)


def changed_part(family: Family, number: int, tolerance: float, kind: str, seed: int) -> tuple[Mesh, float]:
    """Return a part as one of `COPIES` or `VARIANTS` of itself, turned by the seed, and its scale."""
    if kind == "other tolerance":
        tolerance = TOLERANCES[(TOLERANCES.index(tolerance) + 1) % len(TOLERANCES)]
    tolerance *= FINER.get(kind, 1.0)
    phase = PHASE if kind in {"remeshed", "other tolerance", *FINER} else 0.0
    change = next((change for change in VARIANTS if change == kind), None)
    mesh = part(family, Drawing(number, tolerance, phase, change))
    if kind in {"quartered", "decimated"}:
        mesh = quartered(mesh)
    if kind == "decimated":
        mesh = decimated(mesh, tolerance)
    scale = SCALES.get(kind, 1.0)
    return moved(mesh, seed, scale=scale, mirrored=kind == "mirrored"), scale


def _likeness(kind: str, *, chiral: bool) -> Likeness:
    if kind in VARIANTS:
        return "variant"
    return "scaled" if kind in SCALES else "mirrored" if kind == "mirrored" and chiral else "same"


def _stl(family: Family, kind: str, tolerance: float, number: int) -> PlantedPair:
    second, scale = changed_part(family, number, tolerance, kind, number)
    right = _likeness(kind, chiral=family in CHIRAL)
    files = write_mesh(part(family, Drawing(number, tolerance)), "stl"), write_mesh(second, "stl")
    name, known_scale = f"{family} {number}, {tolerance} mm", None if right == "variant" else scale
    return PlantedPair(kind, name, files, frozenset({right}), known_scale, ("stl", "stl"))


def _step(kind: str, number: int, tolerance: float = 0.0) -> PlantedPair:
    """Return a pair of angles with three holes; the reader of STEP chooses the triangles.

    The second is an STL of a chord tolerance if the kind says so.
    """
    draw = Drawing(number, 0.0).draw
    wide, deep, high = draw(80, 110, 0), draw(50, 70, 1), draw(6, 12, 2)
    corners = [(0.0, 0.0), (wide, 0.0), (wide, 0.5 * deep), (0.4 * wide, deep), (0.0, deep)]
    hole = draw(3, 6, 3)
    holes = [(15.0, 15.0, hole), (wide - 20.0, 12.0, 1.2 * hole), (0.25 * wide, deep - 14.0, 1.4 * hole)]
    first = step_prism(corners, holes, high, np.eye(3))
    holes = [*holes, *[(0.5 * wide, 14.0, hole)] * (kind == "hole")]
    holes[0] = (15.0 + 2.0 * (kind == "moved"), 15.0, hole * (LARGER if kind == "larger" else 1.0))
    scale = SCALES.get(kind, 1.0)
    turn = np.linalg.qr(np.random.default_rng(number).normal(size=(3, 3)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    if kind == "mirrored":
        corners, holes = [(-x, y) for x, y in corners[::-1]], [(-x, y, r) for x, y, r in holes]
    if kind == "STL":
        body = Drawing(number, tolerance).drilled(extruded(corners, high), holes, high)
        second = write_mesh(moved(mesh_of(body), number), "stl")
    else:
        second = step_prism(corners, holes, high + LONGER * (kind == "longer"), turn, scale)
    # A prism is its own mirror image.
    right = _likeness(kind, chiral=False)
    known_scale = None if right == "variant" else scale
    about = f"{kind}, STEP", f"prism {number}"
    formats = ("step", "stl" if kind == "STL" else "step")
    return PlantedPair(*about, (first, second), frozenset({right}), known_scale, formats)


def main(folder: Path, seed: int, every: int) -> bool:
    """Write kinship.csv; return whether all bounds hold."""
    answers = compared(islice(planted_pairs(seed), 0, None, every))
    write_table(folder / "kinship.csv", answers)
    copies = [answer for answer in answers if answer.pair.right & COPY]
    confused = [answer for answer in answers if "variant" in answer.pair.right and answer.likeness in COPY]
    confused += [answer for answer in copies if answer.likeness == "variant" and not is_coarser(answer.pair)]
    confused += [answer for answer in copies if answer.error > (ROUGH if is_rough(answer.pair) else SCALE)]
    for answer in confused:
        print(f"{answer.pair.kind}, {answer.pair.name}: {answer.likeness}, scale wrong by {answer.error:.0e}")
    shares = {
        "have the right likeness": [answer.right for answer in answers],
        "have one likeness in three answers": [answer.agreed for answer in answers],
        f"have a scale within {SCALE:g}": [answer.error <= SCALE for answer in copies],
    }
    for about, good in shares.items():
        print(f"{sum(good)} of {len(good)} pairs {about}.")
    within = (good.count(False) <= max(1.0, (1.0 - RIGHT) * len(good)) for good in shares.values())
    return not confused and all(within)


def is_coarser(pair: PlantedPair) -> bool:
    """Return whether the two meshes of a pair have different chord tolerances."""
    return pair.kind == "other tolerance" or pair.kind in FINER or "STL" in pair.kind


def is_rough(pair: PlantedPair) -> bool:
    """Return whether no plane, or only a decimated mesh, tells the scale of a pair."""
    return pair.kind == "decimated" or pair.name.split()[0] in ROUND


if __name__ == "__main__":
    run(main, __doc__, seed=0, every=1)
