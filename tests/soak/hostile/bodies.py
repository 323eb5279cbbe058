"""The meshes that hostile files hold, as vertices of shape (n, 3) and triangles of shape (f, 3)."""

import numpy as np

from tests.core.io.files import CUBE, TRIANGLES

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
ONE = np.array([[0, 1, 2]])

CUBE_CORNERS = CUBE[TRIANGLES]


def with_value(value: float) -> np.ndarray:
    """The cube with one coordinate replaced."""
    changed = CUBE.copy()
    changed[3, 1] = value
    return changed


def sheet(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A hilly square of side^2 vertices."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side), indexing="ij")
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + side, corner + side + 1])
    upper = np.column_stack([corner, corner + side + 1, corner + 1])
    z = 0.2 * np.sin(7 * x) * np.cos(5 * y)
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]), np.vstack([lower, upper])


def flat() -> tuple[np.ndarray, np.ndarray]:
    """A sheet in one plane."""
    vertices, faces = sheet(12)
    return vertices * [1, 1, 0], faces


def fan_about_an_edge() -> tuple[np.ndarray, np.ndarray]:
    """Sixteen triangles on one edge."""
    angles = 2 * np.pi * np.arange(16) / 16
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(16)])
    faces = np.column_stack([np.zeros(16, int), np.ones(16, int), np.arange(2, 18)])
    return np.vstack([[[0, 0, 0], [0, 0, 1]], around]), faces


def loose(count: int) -> tuple[np.ndarray, np.ndarray]:
    """So many triangles that share nothing, of one size, scattered."""
    places = np.random.default_rng(1).uniform(0, 100, (count, 1, 3))
    return (places + TRIANGLE).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def moebius() -> tuple[np.ndarray, np.ndarray]:
    """A strip with one side."""
    steps = 40
    angle = 2 * np.pi * np.arange(steps)[:, None] / steps
    across = np.array([-0.3, 0.0, 0.3])
    radius = 1 + across * np.cos(angle / 2)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)], -1)
    faces = []
    for i in range(steps):
        here = [3 * i, 3 * i + 1, 3 * i + 2]
        there = [3 * i + 3, 3 * i + 4, 3 * i + 5] if i + 1 < steps else [2, 1, 0]
        for j in range(2):
            faces += [[here[j], there[j], here[j + 1]], [here[j + 1], there[j], there[j + 1]]]
    return points.reshape(-1, 3), np.array(faces)


def points_on_a_line() -> tuple[np.ndarray, np.ndarray]:
    """Triangles without area, each with three different corners."""
    vertices = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    return vertices, np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5]])


def one_point() -> tuple[np.ndarray, np.ndarray]:
    """The cube's faces on one point."""
    return np.full_like(CUBE, 0.25), TRIANGLES


STRANGE = {
    "triangle": lambda: (TRIANGLE, ONE),
    "flat": flat,
    "edge": fan_about_an_edge,
    "moebius": moebius,
    "loose": lambda: loose(20_000),
}
WITHOUT_AREA = {
    "line": points_on_a_line,
    "point": one_point,
    "repeated": lambda: (CUBE, np.array([[0, 0, 1], [2, 2, 2], [3, 4, 3]])),
}
