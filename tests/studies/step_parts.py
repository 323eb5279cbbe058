"""Prisms with drilled holes as STEP files: the boundary is exact, and the reader triangulates it."""

from collections.abc import Iterable, Sequence

import numpy as np

from tests.core.io.step_files import Step

Point = tuple[float, float]
Hole = tuple[float, float, float]
Vertex = tuple[str, tuple[float, ...]]
"""An entity and the point where it is before the turn."""


def step_prism(
    outline: Sequence[Point], holes: Iterable[Hole], height: float, turn: np.ndarray, scale: float = 1.0
) -> bytes:
    """Return the STEP file of a prism along z, turned by a rotation, shape (3, 3), and scaled.

    Its corners (x, y) are counterclockwise; its holes (x, y, radius) go through.
    """
    file = _Turned(turn, scale)
    solid = file.prism(outline, holes, height)
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

    def vertex(self, *place: float) -> Vertex:
        return self.add(f"VERTEX_POINT('',{self.point(place)})"), place

    def edge(self, start: Vertex, end: Vertex) -> str:
        way = self.direction(np.subtract(end[1], start[1]))
        line = self.add(f"LINE('',{self.point(start[1])},{self.add(f'VECTOR({chr(39) * 2},{way},1.)')})")
        return str(self.add(f"EDGE_CURVE('',{start[0]},{end[0]},{line},.T.)"))

    def loop(self, *edges: tuple[str, bool]) -> str:
        ways = [self.add(f"ORIENTED_EDGE('',*,*,{edge},{_truth(ahead)})") for edge, ahead in edges]
        return str(self.listed("EDGE_LOOP", ways))

    def face(self, surface: str, outer: str, inner: Iterable[str] = (), *, outward: bool = True) -> str:
        bounds = [self.add(f"FACE_OUTER_BOUND('',{outer},.T.)")]
        bounds += [self.add(f"FACE_BOUND('',{loop},.T.)") for loop in inner]
        return str(self.add(f"ADVANCED_FACE('',({','.join(bounds)}),{surface},{_truth(outward)})"))

    def prism(self, outline: Sequence[Point], holes: Iterable[Hole], height: float) -> str:
        levels = [[self.vertex(x, y, z) for x, y in outline] for z in (0.0, height)]
        rims = [[self.edge(*ends) for ends in _around(level)] for level in levels]
        posts = [self.edge(*ends) for ends in zip(*levels, strict=True)]
        faces = []
        sides = zip(*rims, _around(posts), _around(levels[0]), strict=True)
        for low, high, (post, after), ((_, start), (_, end)) in sides:
            along = np.subtract(end, start)
            plane = self.add(f"PLANE('',{self.placement(start, np.cross(along, (0, 0, 1)), along)})")
            faces.append(
                self.face(plane, self.loop((low, True), (after, True), (high, False), (post, False)))
            )
        rounds = []
        for x, y, radius in holes:
            ends = [self.vertex(x + radius, y, z) for z in (0.0, height)]
            circles = []
            for vertex, (_, _, z) in ends:
                circle = self.add(f"CIRCLE('',{self.placement((x, y, z))},{self.scale * radius!r})")
                circles.append(self.add(f"EDGE_CURVE('',{vertex},{vertex},{circle},.T.)"))
            seam = self.edge(*ends)
            axes = self.placement((x, y, 0.0))
            wall = self.add(f"CYLINDRICAL_SURFACE('',{axes},{self.scale * radius!r})")
            loop = self.loop((circles[0], True), (seam, True), (circles[1], False), (seam, False))
            faces.append(self.face(wall, loop, outward=False))
            rounds.append(circles)
        for level, up in ((0, False), (1, True)):
            plane = self.add(f"PLANE('',{self.placement((0.0, 0.0, level * height))})")
            edges = [(edge, up) for edge in rims[level]]
            outer = self.loop(*(edges if up else edges[::-1]))
            inner = [self.loop((circles[level], not up)) for circles in rounds]
            faces.append(self.face(plane, outer, inner, outward=up))
        return str(self.add(f"MANIFOLD_SOLID_BREP('',{self.listed('CLOSED_SHELL', faces)})"))


def _around(ring: Sequence) -> list[tuple]:
    """Return each member of a ring with the next."""
    return [*zip(ring, [*ring[1:], ring[0]], strict=True)]
