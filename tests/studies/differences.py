"""The largest difference of parts made by code, and its place, against closed forms; and that of copies.

    python -m tests.studies.differences DIR [--seed 0]

In 20 pairs one part has a hole that is moved, a hole, a pin, a pocket or a fillet more, or is 1 mm longer;
20 more are copies: turned, with the vertices of circles elsewhere, with triangles cut in four, or at another
chord tolerance. Lengths are millimetres; second parts are turned, every third is in another unit. Exits with
status 1 unless each largest difference is within 2 % of the closed form and within a hole's radius of its
place, and copies have none. Prints the time of a pair with 10,000 faces.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import Manifold

from core.arrays import Floats
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.ranking.isometry import isometry_distance
from core.ranking.likeness import least_bend
from core.registration.probed_surface import probed_surface
from core.registration.rigid_alignment import rigid_alignment
from core.registration.rigid_copy import copy_by_surfaces
from core.registration.similarity import Similarity
from core.registration.surface_distances import SurfaceDistances, surface_distances
from tests.core.shapes import subdivided
from tests.studies.common import run, write
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, Family, extruded, part

TOLERANCE, COARSER = 0.01, 0.04
"""Chord tolerances in millimetres."""

PHASE = 0.37
UNIT = 25.4

ACCURACY = 0.02
"""Largest relative error of a difference."""

X, Y, Z = np.eye(3)


@dataclass(frozen=True, eq=False)
class Planted:
    """A part, a changed one, and what is known of their largest difference.

    Attributes
    ----------
    kind : str
    first, second : Mesh
        In one frame.
    largest : float
        The closed form.
    places : two of float64, shape (k, 3)
        A point of the place and the directions in which the place extends, as rows: the axis of a hole.
    radius : float
        Largest distance from the place.
    """

    kind: str
    first: Mesh
    second: Mesh
    largest: float
    places: tuple[tuple[Floats, Floats], ...] = ()
    radius: float = 0.0

    def off(self, point: Floats) -> float:
        """Return the distance of a point from the nearest place."""
        return min(
            float(np.linalg.norm((point - origin) - directions.T @ (directions @ (point - origin))))
            for origin, directions in self.places
        )


def block(drawing: Drawing, *, length: float = 0.0, fillet: float = 0.0, shift: float = 0.0) -> Manifold:
    """Return a plate with a step, two rounded corners and three holes, or with changes."""
    wide, deep, thick, hole = drawing.drawn((80, 110), (50, 65), (7, 11), (3, 5))
    corners = [(0.0, 0.0), (wide + length, 0.0), (wide + length, deep), (0.0, deep)]
    body = extruded(drawing.rounded(corners, [6.0, fillet, 10.0, 0.0]), thick)
    step = [(0.0, 0.35 * deep), (0.3 * wide, 0.35 * deep), (0.3 * wide, deep), (0.0, deep)]
    body += extruded(step, 1.8 * thick)
    holes = [(13.0 + shift, 12.0, hole), (wide - 14.0, 13.0, 0.8 * hole), (wide - 22.0, deep - 14.0, hole)]
    return drawing.drilled(body, holes, thick)


def variants(number: int) -> Iterator[tuple[str, Callable[[Drawing], Manifold], float, Any, float]]:
    """Yield changed blocks: kind, part, closed form, places and the largest distance from them."""
    drawing = Drawing(number, TOLERANCE)
    wide, deep, thick, hole = drawing.drawn((80, 110), (50, 65), (7, 11), (3, 5))
    shift, radius, fillet, high, low = drawing.drawn((0.5, 2), (2, 4), (1.5, 4), (1, 4), (0.5, 3))[:5]
    x, y = 0.55 * wide, 0.45 * deep
    middle = np.array([x, y, thick])
    old, new = ((np.array([13.0 + by, 12.0, 0.0]), Z[None]) for by in (0.0, shift))
    yield "hole moved", lambda d: block(d, shift=shift), shift, (old, new), hole
    yield (
        "1 mm longer",
        lambda d: block(d, length=1.0),
        1.0,
        ((np.array([wide, 0, 0]), np.stack([Y, Z])),),
        1.0,
    )
    edge = (np.array([wide, 0.0, 0.0]), Z[None])
    yield "fillet", lambda d: block(d, fillet=fillet), fillet * (2**0.5 - 1.0), (edge,), fillet
    axis = ((middle, Z[None]),)
    deepest = max(radius, 0.5 * thick)
    yield "hole more", lambda d: block(d) - d.drill(x, y, radius, thick), deepest, axis, radius
    pin = lambda d: block(d) + extruded(d.circle(x, y, radius), thick + high)  # noqa: E731
    yield "pin", pin, high, axis, radius
    pocket = lambda d: block(d) - d.drill(x, y, radius, thick).translate((0, 0, thick + 1.0 - low))  # noqa: E731
    yield "pocket", pocket, low, axis, radius


def planted_variants(seed: int) -> Iterator[Planted]:
    """Yield 20 pairs that differ: five each of the first two kinds, and so on, of other dimensions."""
    kinds = 6
    for number in range(20):
        drawing = Drawing(100 * seed + number + 1, TOLERANCE)
        kind, changed, largest, places, radius = list(variants(drawing.number))[number % kinds]
        yield Planted(kind, _mesh(block(drawing)), _mesh(changed(drawing)), largest, places, radius)


def planted_copies(seed: int) -> Iterator[Planted]:
    """Yield 20 pairs of copies of five families."""
    families: tuple[Family, ...] = ("plate", "bracket", "flange", "shaft", "housing")
    for number, family in enumerate(families, 100 * seed + 1):
        first = part(family, Drawing(number, TOLERANCE))
        yield Planted("turned", first, first, 0.0)
        yield Planted("other triangles", first, part(family, Drawing(number, TOLERANCE, PHASE)), 0.0)
        yield Planted("cut in four", first, subdivided(first), 0.0)
        yield Planted("other tolerance", first, part(family, Drawing(number, COARSER, PHASE)), 0.0)


def _mesh(body: Manifold) -> Mesh:
    made = body.to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3], dtype=np.float64), made.tri_verts.astype(np.int64))


def differences(
    first: Mesh, second: Mesh
) -> tuple[Similarity, tuple[SurfaceDistances, SurfaceDistances], float]:
    """Return the transform of the first part onto the second, the distances, and the seconds of both."""
    pipeline = Pipeline()
    embeddings = pipeline.embed(first), pipeline.embed(second)
    ends = pipeline.match(*embeddings).points(*embeddings)
    start = time.process_time()
    surfaces = probed_surface(first), probed_surface(second)
    copy = copy_by_surfaces(*surfaces, ends)
    bent = least_bend(isometry_distance(*embeddings))
    transform = copy.placing.inverse if copy else rigid_alignment(*surfaces, ends, bent)
    assert transform is not None
    both = surface_distances((first, second), surfaces, transform)
    return transform, both, time.process_time() - start


def measured(planted: Planted, number: int) -> dict[str, Any]:
    """Return the row of a pair."""
    scale = UNIT if number % 3 == 2 else 1.0
    turned = moved(planted.second, number, scale=scale)
    transform, both, seconds = differences(planted.first, turned)
    in_first = both[0].largest, both[1].largest / transform.scale
    largest = max(in_first)
    side = int(np.argmax(in_first))
    farthest = both[side].mesh.vertices[np.argmax(both[side].deviating * both[side].distances)]
    place = farthest if side == 0 else transform.invert(farthest[None])[0]
    return {
        "kind": planted.kind,
        "faces": len(planted.first.faces),
        "closed_form": planted.largest,
        "largest": largest,
        "farthest": max(both[0].distances.max(), both[1].distances.max() / transform.scale),
        "error": abs(largest - planted.largest) / planted.largest if planted.largest else largest,
        "off": planted.off(place) if planted.places else 0.0,
        "radius": planted.radius,
        "seconds": seconds,
    }


def main(folder: Path, seed: int) -> bool:
    """Write differences.csv; return whether all bounds hold."""
    pairs = [*planted_variants(seed), *planted_copies(seed)]
    rows = [measured(planted, number) for number, planted in enumerate(pairs)]
    fine = _fine(pairs[0])
    rows.append(measured(fine, 0))
    write(folder / "differences.csv", rows)
    wrong = [
        row
        for row in rows
        if row["error"] > (ACCURACY if row["closed_form"] else 0.0)
        or row["off"] > row["radius"] + TOLERANCE
        or (not row["closed_form"] and row["farthest"] > TOLERANCE + COARSER)
    ]
    print(f"{len(rows) - len(wrong)} of {len(rows)} pairs have the right difference.")
    print(f"{rows[-1]['faces']} faces take {rows[-1]['seconds']:.2f} s of one processor.")
    return not wrong


def _fine(planted: Planted) -> Planted:
    """Return a pair with about 10,000 faces."""
    first, second = planted.first, planted.second
    while len(first.faces) < 5000:
        first, second = subdivided(first), subdivided(second)
    return Planted(f"{planted.kind}, fine", first, second, planted.largest, planted.places, planted.radius)


if __name__ == "__main__":
    run(main, __doc__, seed=0)
