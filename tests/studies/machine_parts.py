"""Machine parts made by code: plates, brackets, flanges, gears, shafts and housings, at any chord tolerance.

Lengths are millimetres. Each part has a family, a number that draws its dimensions, and at most one change.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from numpy.random import default_rng

from core.mesh.mesh import Mesh

Family = Literal["plate", "bracket", "flange", "gear", "shaft", "housing"]
Change = Literal["hole", "moved", "larger", "fillet", "longer"]
Point = tuple[float, float]

LARGER, LONGER, FILLET = 1.05, 1.0, 2.0
"""Factor of a larger hole, additional length, and radius of an additional fillet."""


@dataclass(frozen=True)
class Drawing:
    """How a part is drawn: its dimensions, its change, and its tessellation.

    Attributes
    ----------
    number : int
        Draws the dimensions.
    tolerance : float
        Largest distance between an arc and its chords.
    phase : float
        Where the vertices of circles begin, as a share of a segment.
    change : Change or None
    """

    number: int
    tolerance: float
    phase: float = 0.0
    change: Change | None = None

    def draw(self, low: float, high: float, key: int) -> float:
        """A dimension in tenths of a millimetre."""
        return round(default_rng([self.number, key]).uniform(low, high), 1)

    def circle(self, x: float, y: float, radius: float) -> list[Point]:
        """A circle with vertices on it."""
        count = max(8, int(np.ceil(np.pi / np.arccos(1.0 - self.tolerance / radius))))
        angles = 2.0 * np.pi * (np.arange(count) + self.phase) / count
        return [(x + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in angles]

    def drill(self, x: float, y: float, radius: float, depth: float) -> Manifold:
        """A cylinder along z, from below z = 0 to above the depth."""
        return extruded(self.circle(x, y, radius), depth + 2.0).translate((0.0, 0.0, -1.0))

    def rounded(self, corners: list[Point], radii: list[float]) -> list[Point]:
        """A polygon whose corners are rounded by arcs; a radius of 0 leaves a corner."""
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


def extruded(outline: list[Point], height: float) -> Manifold:
    """The prism between z = 0 and a height."""
    return CrossSection([outline], FillRule.NonZero).extrude(height)


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def plate(drawing: Drawing) -> Manifold:
    """A plate with two rounded corners and three holes."""
    wide, deep, thick = drawing.draw(80, 140, 0), drawing.draw(45, 70, 1), drawing.draw(4, 9, 2)
    hole = drawing.draw(3, 6, 3)
    change = drawing.change
    length = wide + LONGER * (change == "longer")
    corners = [(0.0, 0.0), (length, 0.0), (length, deep), (0.0, deep)]
    body = extruded(drawing.rounded(corners, [6.0, FILLET * (change == "fillet"), 10.0, 0.0]), thick)
    moved = 2.0 * (change == "moved")
    body -= drawing.drill(12.0 + moved, 12.0, hole * (LARGER if change == "larger" else 1.0), thick)
    body -= drawing.drill(wide - 14.0, 13.0, hole, thick)
    body -= drawing.drill(wide / 2.0 + 3.0, deep - 12.0, 1.3 * hole, thick)
    if change == "hole":
        body -= drawing.drill(14.0, deep - 13.0, hole, thick)
    return body


def bracket(drawing: Drawing) -> Manifold:
    """An angle with a rounded inner edge and two holes in each leg."""
    long, high = drawing.draw(60, 90, 0), drawing.draw(40, 55, 1)
    deep, thick, hole = drawing.draw(30, 45, 2), drawing.draw(5, 8, 3), drawing.draw(2.8, 4.5, 4)
    change = drawing.change
    length = long + LONGER * (change == "longer")
    corners = [(0.0, 0.0), (length, 0.0), (length, thick), (thick, thick), (thick, high), (0.0, high)]
    fillet = FILLET * (change == "fillet")
    body = extruded(drawing.rounded(corners, [0.0, fillet, 0.0, 3.0, 0.0, 0.0]), deep)
    body = body.rotate((90.0, 0.0, 0.0)).translate((0.0, deep, 0.0))
    moved = 1.5 * (change == "moved")
    body -= drawing.drill(long - 10.0, deep / 2.0 + moved, hole, thick)
    body -= drawing.drill(long - 32.0, deep / 2.0, hole * (LARGER if change == "larger" else 1.0), thick)
    across = [(deep / 3.0, high - 9.0), (2.0 * deep / 3.0, high - 14.0)]
    if change == "hole":
        across.append((deep / 3.0, high - 24.0))
    for y, z in across:
        body -= drawing.drill(-z, y, 0.8 * hole, thick).rotate((0.0, 90.0, 0.0))
    return body


def flange(drawing: Drawing) -> Manifold:
    """A disc with a hub, a bore and a circle of bolt holes."""
    radius, thick, hub = drawing.draw(45, 70, 0), drawing.draw(8, 12, 1), drawing.draw(14, 22, 2)
    hole, bore = drawing.draw(3, 5, 3), drawing.draw(8, 11, 4)
    count = 4 + drawing.number % 5
    change = drawing.change
    tall = drawing.draw(12, 25, 5) + LONGER * (change == "longer")
    top = tall + thick
    corners = [(0.0, 0.0), (radius, 0.0), (radius, thick), (hub, thick), (hub, top), (0.0, top)]
    fillet = FILLET * (change == "fillet")
    body = revolved(drawing, corners, [0.0, 0.0, fillet, 3.0, 1.0, 0.0])
    body -= drawing.drill(0.0, 0.0, bore, top)
    ring = 0.5 * (hub + 3.0 + radius)
    for k in range(count):
        angle = 2.0 * np.pi * k / count
        if k == 0 and change == "moved":
            angle += 2.0 / ring
        size = hole * (LARGER if k == 0 and change == "larger" else 1.0)
        body -= drawing.drill(ring * np.cos(angle), ring * np.sin(angle), size, thick)
    if change == "hole":
        angle = np.pi / count
        body -= drawing.drill(ring * np.cos(angle), ring * np.sin(angle), hole, thick)
    return body


def gear(drawing: Drawing) -> Manifold:
    """A spur gear with a bore, a keyway and lightening holes."""
    teeth, module, thick = 16 + drawing.number % 13, drawing.draw(2, 3, 0), drawing.draw(8, 14, 1)
    change = drawing.change
    thick += LONGER * (change == "longer")
    pitch = 0.5 * module * teeth
    steps = [(-0.46, -1.2), (-0.32, -0.9), (-0.25, 0.0), (-0.12, 1.0), (0.12, 1.0), (0.25, 0.0), (0.32, -0.9)]
    outline = []
    for tooth in range(teeth):
        for share, height in steps:
            angle, reach = 2.0 * np.pi * (tooth + share) / teeth, pitch + height * module
            outline.append((float(reach * np.cos(angle)), float(reach * np.sin(angle))))
    body = extruded(outline, thick)
    bore = 0.28 * pitch
    body -= drawing.drill(0.0, 0.0, bore, thick)
    corners = [(-2.5, 0.0), (2.5, 0.0), (2.5, bore + 2.3), (-2.5, bore + 2.3)]
    fillet = 0.5 * FILLET * (change == "fillet")
    keyway = extruded(drawing.rounded(corners, [0.0, 0.0, fillet, fillet]), thick + 2.0)
    body -= keyway.translate((0.0, 0.0, -1.0))
    holes = [0.3 + 2.0 * np.pi * k / 3 for k in range(3)] + [0.3 + np.pi / 3] * (change == "hole")
    for k, angle in enumerate(holes):
        reach = 0.6 * pitch + 1.5 * (k == 0 and change == "moved")
        size = 0.14 * pitch * (LARGER if k == 0 and change == "larger" else 1.0)
        body -= drawing.drill(reach * np.cos(angle), reach * np.sin(angle), size, thick)
    return body


def shaft(drawing: Drawing) -> Manifold:
    """A stepped shaft with a rounded shoulder, a keyway and a cross hole."""
    thin, wide = drawing.draw(7, 10, 0), drawing.draw(12, 16, 1)
    ends = drawing.draw(25, 40, 2), drawing.draw(40, 60, 3)
    change = drawing.change
    last = drawing.draw(20, 35, 4) + LONGER * (change == "longer")
    marks = np.cumsum([0.0, *ends, last])
    corners = [(0.0, marks[0]), (thin, marks[0]), (thin, marks[1]), (wide, marks[1]), (wide, marks[2])]
    corners += [(0.8 * thin, marks[2]), (0.8 * thin, marks[3]), (0.0, marks[3])]
    fillet = FILLET * (change == "fillet")
    body = revolved(drawing, corners, [0.0, 1.0, 2.0, 0.0, fillet, 0.0, 0.0, 0.0])
    slot = extruded(drawing.rounded([(-2, -9), (2, -9), (2, 9), (-2, 9)], [2.0 - 1e-6] * 4), 2.0 * wide)
    slot = slot.rotate((90.0, 0.0, 0.0)).translate((0.0, -wide + 3.0, 0.5 * (marks[1] + marks[2])))
    body -= slot
    height = marks[2] + 8.0 + 2.0 * (change == "moved")
    size = 0.3 * thin * (LARGER if change == "larger" else 1.0)
    across = [height] + [marks[1] - 8.0] * (change == "hole")
    for z in across:
        cross = drawing.drill(-z, 0.0, size, 4.0 * wide).rotate((0.0, 90.0, 0.0))
        body -= cross.translate((-2.0 * wide, 0.0, 0.0))
    return body


def housing(drawing: Drawing) -> Manifold:
    """An open box with rounded edges, bosses with blind holes, and a hole in a wall."""
    wide, deep, high = drawing.draw(70, 110, 0), drawing.draw(50, 65, 1), drawing.draw(28, 42, 2)
    wall, hole = drawing.draw(2.5, 4, 3), drawing.draw(7, 10, 4)
    change = drawing.change
    length = wide + LONGER * (change == "longer")
    corners = [(0.0, 0.0), (length, 0.0), (length, deep), (0.0, deep)]
    sharp = 3.0 * (change != "fillet")
    body = extruded(drawing.rounded(corners, [8.0, 8.0, 8.0, 8.0]), high)
    inner = [(wall, wall), (length - wall, wall), (length - wall, deep - wall), (wall, deep - wall)]
    hollow = extruded(drawing.rounded(inner, [5.0, 5.0, 5.0, 5.0 - sharp]), high)
    body -= hollow.translate((0.0, 0.0, wall))
    for x, y in ((14.0, 14.0), (wide - 15.0, 16.0), (wide / 2.0, deep - 15.0)):
        size = 2.0 * (LARGER if x == 14.0 and change == "larger" else 1.0)
        body += extruded(drawing.circle(x, y, 4.5), 0.7 * high)
        body -= drawing.drill(x, y, size, high).translate((0.0, 0.0, 0.3 * high))
    moved = 2.0 * (change == "moved")
    openings = [(0.5 * deep + moved, hole)] + [(0.15 * deep, 3.0)] * (change == "hole")
    for y, radius in openings:
        body -= drawing.drill(-0.5 * high, y, radius, 3.0 * wall).rotate((0.0, 90.0, 0.0))
    return body


def revolved(drawing: Drawing, corners: list[Point], radii: list[float]) -> Manifold:
    """A body of revolution about z, of a profile of (radius, height) with rounded corners."""
    profile = CrossSection([drawing.rounded(corners, radii)], FillRule.NonZero)
    widest = max(radius for radius, _ in corners)
    count = max(8, int(np.ceil(np.pi / np.arccos(1.0 - drawing.tolerance / widest))))
    return profile.revolve(count).rotate((0.0, 0.0, 360.0 / count * drawing.phase))


FAMILIES = {family.__name__: family for family in (plate, bracket, flange, gear, shaft, housing)}


def part(family: Family, drawing: Drawing) -> Mesh:
    """The mesh of a part."""
    made = FAMILIES[family](drawing).to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3], dtype=np.float64), made.tri_verts.astype(np.int64))
