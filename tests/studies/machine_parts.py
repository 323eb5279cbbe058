"""Machine parts made by code, with fillets, tori, threads, thin walls and patterns of holes, at any chord
tolerance.

Lengths are millimetres. Each part has a family, a number that draws its dimensions, and at most one change.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce
from operator import sub
from typing import Literal

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from numpy.random import default_rng

from core.mesh.mesh import Mesh

Family = Literal["plate", "bracket", "flange", "gear", "shaft", "housing", "eyebolt", "bolt", "tray", "grid"]
Change = Literal["hole", "moved", "larger", "fillet", "longer"]
Point = tuple[float, float]

LARGER, LONGER, FILLET = 1.05, 1.0, 2.0
"""Factor of a larger hole, additional length, and radius of an additional fillet."""


@dataclass(frozen=True)
class Drawing:
    """How a part is drawn: the number draws the dimensions.

    The tolerance is the largest distance between an arc and its chords; the phase, where the vertices of
    circles begin, is a share of a segment.
    """

    number: int
    tolerance: float
    phase: float = 0.0
    change: Change | None = None

    def draw(self, low: float, high: float, key: int) -> float:
        """Return a dimension in tenths of a millimetre."""
        return round(default_rng([self.number, key]).uniform(low, high), 1)

    def drawn(self, *ranges: tuple[float, float]) -> list[float]:
        """Return the dimensions of the keys 0, 1, ..."""
        return [self.draw(low, high, key) for key, (low, high) in enumerate(ranges)]

    def of(self, change: Change, amount: float) -> float:
        """Return an amount if the part has the change, or else 0."""
        return amount * (self.change == change)

    @property
    def larger(self) -> float:
        """The factor of the hole that may be larger."""
        return LARGER if self.change == "larger" else 1.0

    def count(self, radius: float) -> int:
        """Return the number of segments of a circle."""
        return max(8, int(np.ceil(np.pi / np.arccos(1.0 - self.tolerance / radius))))

    def circle(self, x: float, y: float, radius: float) -> list[Point]:
        """Return a circle with vertices on it."""
        count = self.count(radius)
        angles = 2.0 * np.pi * (np.arange(count) + self.phase) / count
        return [(x + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in angles]

    def drill(self, x: float, y: float, radius: float, depth: float) -> Manifold:
        """Return a cylinder along z, from below z = 0 to above the depth."""
        return extruded(self.circle(x, y, radius), depth + 2.0).translate((0.0, 0.0, -1.0))

    def drilled(self, body: Manifold, holes: Iterable[tuple[float, float, float]], depth: float) -> Manifold:
        """Return the body without holes (x, y, radius) along z."""
        return reduce(sub, (self.drill(*hole, depth) for hole in holes), body)

    def rounded(self, corners: list[Point], radii: list[float]) -> list[Point]:
        """Return a polygon whose corners are rounded by arcs; a radius of 0 leaves a corner."""
        outline: list[Point] = []
        for i, radius in enumerate(radii):
            corner, before, after = (np.array(corners[j % len(corners)]) for j in (i, i - 1, i + 1))
            if radius == 0.0:
                outline.append((float(corner[0]), float(corner[1])))
                continue
            back, ahead = _unit(before - corner), _unit(after - corner)
            half = 0.5 * np.arccos(back @ ahead)
            centre = corner + radius / np.sin(half) * _unit(back + ahead)
            start = corner + radius / np.tan(half) * back - centre
            turn = np.pi - 2.0 * half
            turn *= np.sign(back[1] * ahead[0] - back[0] * ahead[1])
            step = 2.0 * np.arccos(1.0 - self.tolerance / radius)
            count = max(2, int(np.ceil(abs(turn) / step + self.phase)))
            for angle in np.linspace(0.0, turn, count + 1):
                cos, sin = np.cos(angle), np.sin(angle)
                x, y = cos * start[0] - sin * start[1], sin * start[0] + cos * start[1]
                outline.append((float(centre[0] + x), float(centre[1] + y)))
        return outline

    def ball(self, radius: float) -> Manifold:
        """Return a ball about the origin."""
        return Manifold.sphere(radius, self.count(radius))

    def revolved(self, corners: list[Point], radii: list[float]) -> Manifold:
        """Return a body of revolution about z, of a profile of (radius, height) with rounded corners."""
        profile = CrossSection([self.rounded(corners, radii)], FillRule.NonZero)
        count = self.count(max(radius for radius, _ in corners))
        return profile.revolve(count).rotate((0.0, 0.0, 360.0 / count * self.phase))


def extruded(outline: list[Point], height: float) -> Manifold:
    """Return the prism between z = 0 and a height."""
    return CrossSection([outline], FillRule.NonZero).extrude(height)


def polar(radius: float, angle: float) -> Point:
    """Return a point by its distance from the origin and its angle."""
    return float(radius * np.cos(angle)), float(radius * np.sin(angle))


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def plate(drawing: Drawing) -> Manifold:
    """Return a plate with two rounded corners and three holes."""
    wide, deep, thick, hole = drawing.drawn((80, 140), (45, 70), (4, 9), (3, 6))
    length = wide + drawing.of("longer", LONGER)
    corners = [(0.0, 0.0), (length, 0.0), (length, deep), (0.0, deep)]
    body = extruded(drawing.rounded(corners, [6.0, drawing.of("fillet", FILLET), 10.0, 0.0]), thick)
    holes = [(12.0 + drawing.of("moved", 2.0), 12.0, hole * drawing.larger), (wide - 14.0, 13.0, hole)]
    holes += [(wide / 2.0 + 3.0, deep - 12.0, 1.3 * hole)]
    holes += [(14.0, deep - 13.0, hole)] * (drawing.change == "hole")
    return drawing.drilled(body, holes, thick)


def bracket(drawing: Drawing) -> Manifold:
    """Return an angle with a rounded inner edge and two holes in each leg."""
    long, high, deep, thick, hole = drawing.drawn((60, 90), (40, 55), (30, 45), (5, 8), (2.8, 4.5))
    length = long + drawing.of("longer", LONGER)
    corners = [(0.0, 0.0), (length, 0.0), (length, thick), (thick, thick), (thick, high), (0.0, high)]
    body = extruded(drawing.rounded(corners, [0.0, drawing.of("fillet", FILLET), 0.0, 3.0, 0.0, 0.0]), deep)
    body = body.rotate((90.0, 0.0, 0.0)).translate((0.0, deep, 0.0))
    body -= drawing.drill(long - 10.0, deep / 2.0 + drawing.of("moved", 1.5), hole, thick)
    body -= drawing.drill(long - 32.0, deep / 2.0, hole * drawing.larger, thick)
    across = [(deep / 3.0, high - 9.0), (2.0 * deep / 3.0, high - 14.0)]
    across += [(deep / 3.0, high - 24.0)] * (drawing.change == "hole")
    for y, z in across:
        body -= drawing.drill(-z, y, 0.8 * hole, thick).rotate((0.0, 90.0, 0.0))
    return body


def flange(drawing: Drawing) -> Manifold:
    """Return a disc with a hub, a bore and a circle of bolt holes."""
    radius, thick, hub, hole, bore, tall = drawing.drawn(
        (45, 70), (8, 12), (14, 22), (3, 5), (8, 11), (12, 25)
    )
    count, top = 4 + drawing.number % 5, tall + drawing.of("longer", LONGER) + thick
    corners = [(0.0, 0.0), (radius, 0.0), (radius, thick), (hub, thick), (hub, top), (0.0, top)]
    body = drawing.revolved(corners, [0.0, 0.0, drawing.of("fillet", FILLET), 3.0, 1.0, 0.0])
    body -= drawing.drill(0.0, 0.0, bore, top)
    ring = 0.5 * (hub + 3.0 + radius)
    angles = 2.0 * np.pi * np.arange(count) / count
    angles[0] += drawing.of("moved", 2.0 / ring)
    sizes = [hole * drawing.larger] + [hole] * (count - 1)
    holes = [*zip(angles, sizes, strict=True), *[(np.pi / count, hole)] * (drawing.change == "hole")]
    return drawing.drilled(body, ((*polar(ring, angle), size) for angle, size in holes), thick)


def gear(drawing: Drawing) -> Manifold:
    """Return a spur gear with a bore, a keyway and lightening holes."""
    module, thick = drawing.drawn((2, 3), (8, 14))
    teeth, thick = 16 + drawing.number % 13, thick + drawing.of("longer", LONGER)
    pitch = 0.5 * module * teeth
    steps = [(-0.46, -1.2), (-0.32, -0.9), (-0.25, 0.0), (-0.12, 1.0), (0.12, 1.0), (0.25, 0.0), (0.32, -0.9)]
    outline = []
    for tooth in range(teeth):
        for share, height in steps:
            outline.append(polar(pitch + height * module, 2.0 * np.pi * (tooth + share) / teeth))
    bore = 0.28 * pitch
    body = extruded(outline, thick) - drawing.drill(0.0, 0.0, bore, thick)
    corners = [(-2.5, 0.0), (2.5, 0.0), (2.5, bore + 2.3), (-2.5, bore + 2.3)]
    fillet = drawing.of("fillet", 0.5 * FILLET)
    keyway = extruded(drawing.rounded(corners, [0.0, 0.0, fillet, fillet]), thick + 2.0)
    body -= keyway.translate((0.0, 0.0, -1.0))
    holes = [0.3 + 2.0 * np.pi * k / 3 for k in range(3)] + [0.3 + np.pi / 3] * (drawing.change == "hole")
    for k, angle in enumerate(holes):
        reach = 0.6 * pitch + (drawing.of("moved", 1.5) if k == 0 else 0.0)
        size = 0.14 * pitch * (drawing.larger if k == 0 else 1.0)
        body -= drawing.drill(*polar(reach, angle), size, thick)
    return body


def shaft(drawing: Drawing) -> Manifold:
    """Return a stepped shaft with a rounded shoulder, a keyway and a cross hole."""
    thin, wide, *lengths = drawing.drawn((7, 10), (12, 16), (25, 40), (40, 60), (20, 35))
    lengths[-1] += drawing.of("longer", LONGER)
    marks = np.cumsum([0.0, *lengths])
    corners = [(0.0, marks[0]), (thin, marks[0]), (thin, marks[1]), (wide, marks[1]), (wide, marks[2])]
    corners += [(0.8 * thin, marks[2]), (0.8 * thin, marks[3]), (0.0, marks[3])]
    body = drawing.revolved(corners, [0.0, 1.0, 2.0, 0.0, drawing.of("fillet", FILLET), 0.0, 0.0, 0.0])
    slot = extruded(drawing.rounded([(-2, -9), (2, -9), (2, 9), (-2, 9)], [2.0 - 1e-6] * 4), 2.0 * wide)
    body -= slot.rotate((90.0, 0.0, 0.0)).translate((0.0, -wide + 3.0, 0.5 * (marks[1] + marks[2])))
    across = [marks[2] + 8.0 + drawing.of("moved", 2.0)] + [marks[1] - 8.0] * (drawing.change == "hole")
    for z in across:
        cross = drawing.drill(-z, 0.0, 0.3 * thin * drawing.larger, 4.0 * wide).rotate((0.0, 90.0, 0.0))
        body -= cross.translate((-2.0 * wide, 0.0, 0.0))
    return body


def housing(drawing: Drawing) -> Manifold:
    """Return an open box with rounded edges, bosses with blind holes, and a hole in a wall."""
    wide, deep, high, wall, hole = drawing.drawn((70, 110), (50, 65), (28, 42), (2.5, 4), (7, 10))
    length = wide + drawing.of("longer", LONGER)
    corners = [(0.0, 0.0), (length, 0.0), (length, deep), (0.0, deep)]
    body = extruded(drawing.rounded(corners, [8.0, 8.0, 8.0, 8.0]), high)
    inner = [(wall, wall), (length - wall, wall), (length - wall, deep - wall), (wall, deep - wall)]
    fillet = 5.0 if drawing.change == "fillet" else 2.0
    body -= extruded(drawing.rounded(inner, [5.0, 5.0, 5.0, fillet]), high).translate((0.0, 0.0, wall))
    for x, y, factor in (
        (14.0, 14.0, drawing.larger),
        (wide - 15.0, 16.0, 1.0),
        (wide / 2.0, deep - 15.0, 1.0),
    ):
        body += extruded(drawing.circle(x, y, 4.5), 0.7 * high)
        body -= drawing.drill(x, y, 2.0 * factor, high).translate((0.0, 0.0, 0.3 * high))
    openings = [(0.5 * deep + drawing.of("moved", 2.0), hole)]
    openings += [(0.15 * deep, 3.0)] * (drawing.change == "hole")
    for y, radius in openings:
        body -= drawing.drill(-0.5 * high, y, radius, 3.0 * wall).rotate((0.0, 90.0, 0.0))
    return body


def eyebolt(drawing: Drawing) -> Manifold:
    """Return a torus on a shank with a rounded end, with holes through the tube."""
    ring, tube, long = drawing.drawn((22, 34), (5, 7), (40, 60))
    count = drawing.count(ring + tube)
    turned = 360.0 / count * drawing.phase
    body = (
        CrossSection([drawing.circle(ring, 0.0, tube)], FillRule.NonZero)
        .revolve(count)
        .rotate((0, 0, turned))
    )
    thick, end = 0.8 * tube, ring + long + drawing.of("longer", LONGER)
    corners = [(0.0, ring), (thick, ring), (thick, end), (0.0, end)]
    rounds = [0.0, 0.0, 1.0 + drawing.of("fillet", FILLET), 0.0]
    body += drawing.revolved(corners, rounds).rotate((90.0, 0.0, 0.0))
    angles = [0.6 + drawing.of("moved", 2.0 / ring), 2.1] + [1.3] * (drawing.change == "hole")
    for k, angle in enumerate(angles):
        radius = 0.4 * tube * (drawing.larger if k == 0 else 1.0)
        body -= drawing.drill(*polar(ring, angle), radius, 2.0 * tube).translate((0.0, 0.0, -tube))
    return body


def bolt(drawing: Drawing) -> Manifold:
    """Return a hexagonal head with a V thread of one start, and cross holes in its head."""
    size, pitch, long = drawing.drawn((5, 8), (2.0, 3.0), (25, 40))
    count = drawing.count(size)
    angles = 2.0 * np.pi * (np.arange(count) + drawing.phase) / count
    depths = size - 0.6 * pitch * np.abs(2.0 * ((angles / (2.0 * np.pi)) % 1.0) - 1.0)
    outline = [polar(depth, angle) for depth, angle in zip(depths, angles, strict=True)]
    turns = np.ceil((long + drawing.of("longer", LONGER)) / pitch)
    thread = CrossSection([outline], FillRule.NonZero).extrude(
        turns * pitch, int(turns * count), 360.0 * float(turns)
    )
    thread = thread.trim_by_plane((0.0, 0.0, -1.0), -long - drawing.of("longer", LONGER))
    high = 1.4 * size
    corners = [polar(2.0 * size, np.pi / 3.0 * k) for k in range(6)]
    rounds = [1.0] * 5 + [1.0 + drawing.of("fillet", FILLET)]
    body = extruded(drawing.rounded(corners, rounds), high).translate((0.0, 0.0, -high)) + thread
    places = [(1.0 + drawing.of("moved", 1.0), 0.0), (-0.8 * size, 0.3)] + [(0.8 * size, 0.9)] * (
        drawing.change == "hole"
    )
    for k, (x, turn) in enumerate(places):
        radius = 0.4 * size * (drawing.larger if k == 0 else 1.0)
        across = drawing.drill(0.5 * high, x, radius, 4.0 * size).translate((0.0, 0.0, -2.0 * size))
        body -= across.rotate((0.0, 90.0, 0.0)).rotate((0.0, 0.0, float(np.degrees(turn))))
    return body


def tray(drawing: Drawing) -> Manifold:
    """Return a thin shell, rounded at its sides and its bottom, with holes in the bottom."""
    wide, deep, high, wall, hole = drawing.drawn((60, 90), (40, 55), (18, 30), (1.0, 1.6), (3, 5))
    length = wide + drawing.of("longer", LONGER)
    radii = [7.0, 7.0, 7.0, 7.0 - drawing.of("fillet", FILLET)]

    def filled(inset: float) -> Manifold:
        # The hull of four balls, with the upper ends of the walls.
        ends = []
        for k, radius in enumerate(radii):
            x, y = (length - radius if k % 2 else radius), (deep - radius if k > 1 else radius)
            ends.append(drawing.ball(radius - inset).translate((x, y, radius)))
            ends.append(drawing.drill(x, y, radius - inset, high).translate((0.0, 0.0, 8.0)))
        return Manifold.batch_hull(ends)

    body = (filled(0.0) - filled(wall)).trim_by_plane((0.0, 0.0, -1.0), -high)
    holes = [(18.0 + drawing.of("moved", 2.0), 16.0, hole * drawing.larger), (wide - 20.0, 18.0, hole)]
    holes += [(0.5 * wide, deep - 14.0, hole)] * (drawing.change == "hole")
    return drawing.drilled(body, holes, 3.0 * wall)


def grid(drawing: Drawing) -> Manifold:
    """Return a thin sheet with a pattern of holes."""
    pitch, thick, hole = drawing.drawn((12, 16), (1.5, 3), (2.5, 4))
    rows, columns = 3 + drawing.number % 2, 5 + drawing.number % 3
    wide, deep = columns * pitch + drawing.of("longer", LONGER), rows * pitch
    corners = [(0.0, 0.0), (wide, 0.0), (wide, deep), (0.0, deep)]
    body = extruded(drawing.rounded(corners, [5.0, 5.0, 5.0, 5.0 - drawing.of("fillet", FILLET)]), thick)
    holes = [((x + 0.5) * pitch, (y + 0.5) * pitch, hole) for x in range(columns) for y in range(rows)]
    # The pattern lacks a hole, so that it tells its ends.
    lacking = holes.pop(rows)
    x, y, _ = holes[0]
    holes[0] = (x + drawing.of("moved", 1.5), y, hole * drawing.larger)
    holes += [lacking] * (drawing.change == "hole")
    return drawing.drilled(body, holes, thick)


FAMILIES: dict[Family, Callable[[Drawing], Manifold]] = {
    **{"plate": plate, "bracket": bracket, "flange": flange, "gear": gear, "shaft": shaft},
    **{"housing": housing, "eyebolt": eyebolt, "bolt": bolt, "tray": tray, "grid": grid},
}


def part(family: Family, drawing: Drawing) -> Mesh:
    """Return the mesh of a part."""
    return mesh_of(FAMILIES[family](drawing))


def mesh_of(body: Manifold) -> Mesh:
    """Return the surface of a body."""
    made = body.to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3], dtype=np.float64), made.tri_verts.astype(np.int64))
