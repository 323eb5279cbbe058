"""Solids of cubes: plates with holes and furniture, as closed meshes."""

import numpy as np

from core.mesh.mesh import Mesh

SIDE = 0.1


def solid(filled):
    """The surface of the filled cells of a grid, a bool array of three dimensions."""
    padded = np.pad(np.asarray(filled, dtype=bool), 1)
    quads = []
    for axis in range(3):
        inside, outside = padded, np.roll(padded, -1, axis)
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        for cells, turned in ((inside & ~outside, False), (outside & ~inside, True)):
            corner = np.argwhere(cells) + np.eye(3, dtype=int)[axis]
            quad = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
            quads.append(quad[:, ::-1] if turned else quad)
    corners = np.concatenate(quads)
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = index.reshape(-1, 4).T
    return Mesh(SIDE * (points - 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def plate(holes):
    """A plate of 3 by 2 by 0.2, with square holes of 0.3 at grid places (i, j)."""
    filled = np.ones((30, 20, 2), dtype=bool)
    for i, j in holes:
        filled[i : i + 3, j : j + 3] = False
    return solid(filled)


def chair(legs=4):
    """A chair of a seat, a back and so many of its four legs."""
    filled = np.zeros((12, 11, 24), dtype=bool)
    filled[:, :, 10:12] = True
    filled[:2, :, 12:] = True
    for i, j in ((0, 0), (0, 9), (10, 0), (10, 9))[:legs]:
        filled[i : i + 2, j : j + 2, :10] = True
    return solid(filled)


def bent_chair():
    """A chair with one leg bent outwards."""
    whole = chair()
    points = whole.vertices.copy()
    leg = (points[:, 0] > 0.95) & (points[:, 1] > 0.85) & (points[:, 2] < 0.95)
    points[leg, 0] += 0.6 * (1.0 - points[leg, 2])
    return Mesh(points, whole.faces)
