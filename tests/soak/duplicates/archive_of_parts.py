"""An archive of parts made by code: seven of ten are new, two are copies, one is a variant."""

from collections.abc import Iterator
from itertools import islice

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.soak.duplicates.copies import moved
from tests.soak.kinship.parts import Drawing, Family, part
from tests.soak.kinship.planted import COPIES, FAMILIES, PHASE, TOLERANCES, VARIANTS

OWN, PLANTED, AMONG = 7, 3, 10


def parts(count: int, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """Names and files of `count` parts; each copy and each variant is of an earlier part."""
    yield from islice(_parts(50_000 + 100_000 * seed), count)


def _parts(number: int) -> Iterator[tuple[str, bytes]]:
    drawn: list[tuple[Family, int, float]] = []
    while True:
        for _ in range(OWN):
            number += 1
            drawn.append((FAMILIES[number % len(FAMILIES)], number, TOLERANCES[number % len(TOLERANCES)]))
            family, own, tolerance = drawn[-1]
            yield _named(family, own, "first", number, part(family, Drawing(own, tolerance)))
        for place in range(PLANTED):
            rng = np.random.default_rng([number, place])
            family, own, tolerance = drawn[rng.integers(len(drawn))]
            kinds = VARIANTS if place == PLANTED - 1 else COPIES
            kind = str(kinds[rng.integers(len(kinds))])
            scale = {"25.4": 25.4, "1/3": 1.0 / 3.0}.get(kind, 1.0)
            mesh = _made(family, own, tolerance, kind)
            mesh = moved(mesh, number + place, scale=scale, mirrored=kind == "mirrored")
            yield _named(family, own, kind.replace("/", " of "), AMONG * number + place, mesh)


def _made(family: Family, number: int, tolerance: float, kind: str) -> Mesh:
    if kind == "remeshed":
        return part(family, Drawing(number, tolerance, PHASE))
    if kind == "other tolerance":
        other = TOLERANCES[(TOLERANCES.index(tolerance) + 1) % len(TOLERANCES)]
        return part(family, Drawing(number, other, PHASE))
    change = next((each for each in VARIANTS if each == kind), None)
    return part(family, Drawing(number, tolerance, change=change))


def _named(family: Family, number: int, kind: str, key: int, mesh: Mesh) -> tuple[str, bytes]:
    return f"{family}-{number}-{kind}-{key}.stl", write_mesh(mesh, "stl")
