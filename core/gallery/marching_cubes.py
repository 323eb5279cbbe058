"""Marching cubes: the surface on which the values of a grid are zero.

W. Lorensen, H. Cline, "Marching cubes: a high resolution 3D surface construction algorithm", 1987. The table
of its 256 cases is computed here: the surface cuts each face of a cube along segments that separate its
negative corners, so two cubes cut their common face alike and the surface is closed.
"""

from functools import cache
from itertools import product

import numpy as np

from core.arrays import Floats, Ints

CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Corners of a cube, shape (8, 3)."""

EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]
"""The corners at the ends of each of the 12 edges, the lower corner first."""

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
"""The corners of each face, in a circle: counter-clockwise seen from outside."""


def marching_cubes(values: Floats) -> tuple[Floats, Ints]:
    """Return the surface between the negative and the positive values of a grid: vertices and faces.

    The values, shape (a, b, c), are at the corners of unit cubes, not 0, and positive at the border. The
    vertices, shape (n, 3), are on the edges of cubes, where the values are zero if they are linear along the
    edges; the faces, shape (f, 3), are counter-clockwise seen from the positive side.
    """
    shape = np.array(values.shape)
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    # The case of each cube: a bit for each of its negative corners.
    negative = values < 0.0
    cases = np.zeros(tuple(shape - 1), dtype=np.int64)
    for bit, (x, y, z) in enumerate(CORNERS):
        window = negative[x : shape[0] - 1 + x, y : shape[1] - 1 + y, z : shape[2] - 1 + z]
        cases |= window.astype(np.int64) << bit
    cubes = np.argwhere((cases > 0) & (cases < 255))
    # An edge of the grid has the number of its lower corner, times three, plus its axis.
    lower = np.array([CORNERS[a] @ strides for a, _ in EDGES])
    axes = np.array([np.flatnonzero(CORNERS[b] - CORNERS[a])[0] for a, b in EDGES])
    edges = 3 * ((cubes @ strides)[:, None] + lower) + axes
    table = _triangles()[cases[tuple(cubes.T)]]
    cube, triangle = np.nonzero(table[:, :, 0] >= 0)
    crossed, faces = np.unique(edges[cube[:, None], table[cube, triangle]], return_inverse=True)
    # The place of the zero on each crossed edge.
    axis, corner = crossed % 3, crossed // 3
    at_corner, beyond = (
        values.ravel()[which].astype(np.float64) for which in (corner, corner + strides[axis])
    )
    vertices = np.stack(np.unravel_index(corner, values.shape), axis=1).astype(np.float64)
    vertices[np.arange(len(axis)), axis] += at_corner / (at_corner - beyond)
    return vertices, faces.reshape(-1, 3).astype(np.int64)


@cache
def _triangles() -> Ints:
    """Return the triangles of each case, shape (256, t, 3): edges of the cube, -1 after the last triangle."""
    cases = [[triangle for loop in _loops(case) for triangle in _fan(loop)] for case in range(256)]
    table = np.full((256, max(map(len, cases)), 3), -1, dtype=np.int64)
    for case, triangles in enumerate(cases):
        if triangles:
            table[case, : len(triangles)] = triangles
    return table


def _loops(case: int) -> list[list[int]]:
    """Return the closed loops of edges in which the surface cuts a cube, counter-clockwise from outside."""
    number = {frozenset(edge): i for i, edge in enumerate(EDGES)}
    following = {}
    for face in FACES:
        # From each edge at which the circle enters the negative corners to the one at which it leaves them.
        inside = [bool(case >> corner & 1) for corner in face]
        for start in range(4):
            if inside[start] and not inside[start - 1]:
                end = next(i for i in range(start, start + 4) if not inside[(i + 1) % 4])
                entered = number[frozenset((face[start - 1], face[start]))]
                following[entered] = number[frozenset((face[end % 4], face[(end + 1) % 4]))]
    loops = []
    while following:
        first, edge = following.popitem()
        loop = [first]
        while edge != first:
            loop.append(edge)
            edge = following.pop(edge)
        loops.append(loop)
    return loops


def _fan(loop: list[int]) -> list[tuple[int, int, int]]:
    """Return the triangles of a loop, about the edge that has the fewest diagonals within faces of the cube.

    A diagonal within a face may be one of the next cube as well, and then has four triangles.
    """
    faces_of = [{i for i, face in enumerate(FACES) if set(EDGES[edge]) <= set(face)} for edge in range(12)]

    def within(turned: list[int]) -> int:
        return sum(bool(faces_of[turned[0]] & faces_of[edge]) for edge in turned[2:-1])

    best = min((loop[i:] + loop[:i] for i in range(len(loop))), key=within)
    return [(best[0], best[i], best[i + 1]) for i in range(1, len(best) - 1)]
