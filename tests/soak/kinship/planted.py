"""Pairs of parts made by code, each with the likeness and the scale that are right for it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from core.io import FORMATS, write_mesh
from core.mesh.mesh import Mesh
from core.ranking.likeness import Likeness
from tests.soak.duplicates.copies import moved
from tests.soak.kinship.parts import LARGER, LONGER, Change, Drawing, Family, part
from tests.soak.kinship.step_parts import Prism

TOLERANCES = (0.02, 0.05, 0.1)
"""Chord tolerances in millimetres."""

FAMILIES: tuple[Family, ...] = ("plate", "bracket", "flange", "gear", "shaft", "housing")
CHIRAL: frozenset[Family] = frozenset({"bracket", "housing"})
"""Families whose parts differ from their mirror images; prisms and bodies of revolution do not."""

COPIES = ("turned", "25.4", "1/3", "mirrored", "remeshed", "other tolerance")
VARIANTS: tuple[Change, ...] = ("hole", "moved", "larger", "fillet", "longer")
PHASE = 0.37
"""Share of a segment by which the vertices of the circles of a remeshed part are turned."""


@dataclass(frozen=True, eq=False)
class PlantedPair:
    """Two files, and the likeness of the second to the first that is right, with its scale if it has one."""

    kind: str
    name: str
    files: tuple[bytes, bytes]
    format: str
    right: Likeness
    scale: float | None


def planted_pairs(seed: int) -> Iterator[PlantedPair]:
    """198 pairs as STL, and 16 as STEP if it can be read; another seed gives parts of other dimensions."""
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


def _stl(family: Family, kind: str, tolerance: float, number: int) -> PlantedPair:
    first = part(family, Drawing(number, tolerance))
    scale = {"25.4": 25.4, "1/3": 1.0 / 3.0}.get(kind, 1.0)
    second = first
    if kind == "remeshed":
        second = part(family, Drawing(number, tolerance, PHASE))
    elif kind == "other tolerance":
        other = TOLERANCES[(TOLERANCES.index(tolerance) + 1) % len(TOLERANCES)]
        second = part(family, Drawing(number, other, PHASE))
    elif kind in VARIANTS:
        second = part(family, Drawing(number, tolerance, change=kind))
    second = moved(second, number, scale=scale, mirrored=kind == "mirrored")
    right: Likeness = "scaled" if scale != 1.0 else "same"
    if kind in VARIANTS:
        right = "variant"
    elif kind == "mirrored" and family in CHIRAL:
        right = "mirrored"
    name = f"{family} {number}, {tolerance} mm"
    return PlantedPair(kind, name, (_file(first), _file(second)), "stl", right, scale)


def _file(mesh: Mesh) -> bytes:
    return write_mesh(mesh, "stl")


def _step(kind: str, number: int) -> PlantedPair:
    """An angle with three holes; the reader of STEP chooses the triangles."""
    draw = Drawing(number, 0.0).draw
    wide, deep, high = draw(80, 110, 0), draw(50, 70, 1), draw(6, 12, 2)
    corners = [(0.0, 0.0), (wide, 0.0), (wide, 0.5 * deep), (0.4 * wide, deep), (0.0, deep)]
    hole = draw(3, 6, 3)
    holes = [(15.0, 15.0, hole), (wide - 20.0, 12.0, 1.2 * hole), (0.25 * wide, deep - 14.0, 1.4 * hole)]
    first = Prism(corners, holes, high)
    if kind == "hole":
        holes = [*holes, (0.5 * wide, 14.0, hole)]
    elif kind == "moved":
        holes = [(17.0, 15.0, hole), *holes[1:]]
    elif kind == "larger":
        holes = [(15.0, 15.0, LARGER * hole), *holes[1:]]
    changed = Prism(corners, holes, high + LONGER * (kind == "longer"))
    scale = {"25.4": 25.4, "1/3": 1.0 / 3.0}.get(kind, 1.0)
    turn = np.linalg.qr(np.random.default_rng(number).normal(size=(3, 3)))[0]
    # A prism is its own mirror image.
    turn[0] *= np.sign(np.linalg.det(turn))
    if kind == "mirrored":
        changed = Prism([(-x, y) for x, y in corners[::-1]], [(-x, y, r) for x, y, r in holes], high)
    right: Likeness = "variant" if kind in VARIANTS else "scaled" if scale != 1.0 else "same"
    files = first.step(np.eye(3)), changed.step(turn, scale)
    return PlantedPair(f"{kind}, STEP", f"prism {number}", files, "step", right, scale)
