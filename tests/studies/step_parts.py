"""Prisms with drilled holes as STEP files: the boundary is exact, and the reader triangulates it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.core.io.step_files import Step

Point = tuple[float, float]
Hole = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Prism:
    """A prism along z: its corners (x, y), counterclockwise, its through holes (x, y, radius), and its
    height."""

    outline: list[Point]
    holes: list[Hole]
    height: float

    def step(self, turn: np.ndarray, scale: float = 1.0) -> bytes:
        """Return the STEP file of the prism, turned by a rotation, shape (3, 3), and scaled."""
        file = _Turned(turn, scale)
        solid = file.prism(self)
        # The axes of the product are not turned.
        file.turn = np.eye(3)
        file.product("part", [solid], file.context("millimetre"))
        return bytes(file.data())


def _truth(value: bool) -> str:
    return ".T." if value else ".F."


class _Turned(Step):
    """Entities whose points and directions are turned and scaled."""

    def __init__(self, turn: np.ndarray, scale: float):
        super().__init__()
        self.turn, self.scale = turn, scale

    def point(self, place: Sequence[float]) -> str:
        return str(super().point(self.scale * self.turn @ place))

    def direction(self, way: Sequence[float]) -> str:
        return str(super().direction(self.turn @ way))

    def vertex(self, *place: float) -> str:
        return str(self.add(f"VERTEX_POINT('',{self.point(place)})"))

    def edge(self, vertices, start, end) -> str:
        """Add a straight edge between two vertices, (start, end), at two places."""
        way = self.direction(np.subtract(end, start))
        line = self.add(f"LINE('',{self.point(start)},{self.add(f'VECTOR({chr(39) * 2},{way},1.)')})")
        return str(self.add(f"EDGE_CURVE('',{vertices[0]},{vertices[1]},{line},.T.)"))

    def loop(self, *edges: tuple[str, bool]) -> str:
        ways = [self.add(f"ORIENTED_EDGE('',*,*,{edge},{_truth(ahead)})") for edge, ahead in edges]
        return str(self.listed("EDGE_LOOP", ways))

    def face(self, surface: str, outer: str, inner=(), *, outward: bool = True) -> str:
        bounds = [self.add(f"FACE_OUTER_BOUND('',{outer},.T.)")]
        bounds += [self.add(f"FACE_BOUND('',{loop},.T.)") for loop in inner]
        return str(self.add(f"ADVANCED_FACE('',({','.join(bounds)}),{surface},{_truth(outward)})"))

    def prism(self, part: Prism) -> str:
        count, top = len(part.outline), part.height
        corners = [[(x, y, z) for x, y in part.outline] for z in (0.0, top)]
        vertices = [[self.vertex(*corner) for corner in level] for level in corners]
        after = [(i + 1) % count for i in range(count)]
        rims = [
            [self.edge((level[i], level[after[i]]), corner[i], corner[after[i]]) for i in range(count)]
            for level, corner in zip(vertices, corners, strict=True)
        ]
        posts = [
            self.edge((vertices[0][i], vertices[1][i]), corners[0][i], corners[1][i]) for i in range(count)
        ]
        faces = []
        for i, j in enumerate(after):
            along = np.subtract(corners[0][j], corners[0][i])
            plane = self.add(f"PLANE('',{self.placement(corners[0][i], np.cross(along, (0, 0, 1)), along)})")
            loop = self.loop((rims[0][i], True), (posts[j], True), (rims[1][i], False), (posts[i], False))
            faces.append(self.face(plane, loop))
        rounds = []
        for x, y, radius in part.holes:
            starts = [self.vertex(x + radius, y, z) for z in (0.0, top)]
            circles = []
            for start, z in zip(starts, (0.0, top), strict=True):
                axes = self.placement((x, y, z), (0, 0, 1), (1, 0, 0))
                circle = self.add(f"CIRCLE('',{axes},{self.scale * radius!r})")
                circles.append(self.add(f"EDGE_CURVE('',{start},{start},{circle},.T.)"))
            seam = self.edge(starts, (x + radius, y, 0.0), (x + radius, y, top))
            axes = self.placement((x, y, 0.0), (0, 0, 1), (1, 0, 0))
            wall = self.add(f"CYLINDRICAL_SURFACE('',{axes},{self.scale * radius!r})")
            loop = self.loop((circles[0], True), (seam, True), (circles[1], False), (seam, False))
            faces.append(self.face(wall, loop, outward=False))
            rounds.append(circles)
        for level, up in ((0, False), (1, True)):
            plane = self.add(f"PLANE('',{self.placement((0.0, 0.0, level * top), (0, 0, 1), (1, 0, 0))})")
            edges = [(edge, up) for edge in rims[level]]
            outer = self.loop(*(edges if up else edges[::-1]))
            inner = [self.loop((circles[level], not up)) for circles in rounds]
            faces.append(self.face(plane, outer, inner, outward=up))
        return str(self.add(f"MANIFOLD_SOLID_BREP('',{self.listed('CLOSED_SHELL', faces)})"))
