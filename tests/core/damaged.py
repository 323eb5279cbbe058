"""Ten ways in which models of the web are damaged: a mesh and a random generator in, a mesh out."""

import numpy as np

from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from tests.core.shapes import box, joined, scaled, shifted

SHEETS, CELLS = 40, 24


def moved_far(mesh, rng):
    return shifted(mesh, [1e6, -1e6, 1e6])


def made_tiny(mesh, rng):
    return scaled(mesh, 1e-6)


def _components(mesh):
    return component_labels(len(mesh.vertices), mesh.faces)[1]


def component_doubled(mesh, rng):
    """The largest component once more in its place, with vertices of its own."""
    labels = _components(mesh)[mesh.faces[:, 0]]
    largest = mesh.faces[labels == np.bincount(labels).argmax()]
    return joined(mesh, Mesh(mesh.vertices, largest))


def component_shrunk(mesh, rng):
    """All vertices of one component in one point; of a single component a third of the faces."""
    labels = _components(mesh)
    used = np.unique(labels[mesh.faces])
    chosen = labels == rng.choice(used)
    if len(used) == 1:
        chosen = np.unique(mesh.faces[: len(mesh.faces) // 3])
    vertices = mesh.vertices.copy()
    vertices[chosen] = vertices[chosen].mean(axis=0)
    return Mesh(vertices, mesh.faces)


def faces_repeated(mesh, rng):
    """Half of the faces twice more, once with the other orientation."""
    again = mesh.faces[rng.integers(len(mesh.faces), size=1 + len(mesh.faces) // 2)]
    return Mesh(mesh.vertices, np.vstack([mesh.faces, again, again[:, ::-1]]))


def coplanar_sheets(mesh, rng):
    """Rectangles in one plane through the mesh; many touch, overlap or coincide."""
    low, size = mesh.vertices.min(axis=0), np.ptp(mesh.vertices, axis=0)
    sheets = []
    for _ in range(SHEETS):
        start = low + size * [*rng.choice([0.0, 0.25, 0.5], size=2), 0.5]
        width, depth = size[:2] * rng.choice([0.25, 0.5], size=2)
        corners = start + np.array([[0, 0, 0], [width, 0, 0], [width, depth, 0], [0, depth, 0]])
        sheets.append(Mesh(corners, [[0, 1, 2], [0, 2, 3]]))
    return joined(mesh, *sheets)


def faces_apart(mesh, rng):
    """Each face with corners of its own, in random order."""
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    return Mesh(mesh.vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))


def vertices_on_a_grid(mesh, rng):
    """Vertices rounded to a coarse grid: pieces touch, faces lose their area."""
    low = mesh.vertices.min(axis=0)
    step = np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / CELLS
    return Mesh(np.rint((mesh.vertices - low) / step) * step, mesh.faces)


def faces_missing(mesh, rng):
    """A random half of the faces."""
    return Mesh(mesh.vertices, mesh.faces[rng.permutation(len(mesh.faces))[: 1 + len(mesh.faces) // 2]])


def mirrored_in_place(mesh, rng):
    """The mesh and its mirror image, which crosses it."""
    return joined(mesh, Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1]))


DAMAGES = {
    damage.__name__: damage
    for damage in (
        moved_far,
        made_tiny,
        component_doubled,
        component_shrunk,
        faces_repeated,
        coplanar_sheets,
        faces_apart,
        vertices_on_a_grid,
        faces_missing,
        mirrored_in_place,
    )
}


def touching_boxes(count, seed=0):
    """Boxes of a grid that share corners, edges and faces, each with vertices of its own; some coincide."""
    cells = np.random.default_rng(seed).integers(0, 4, size=(count, 3))
    corners = box(1, 1, 1).vertices
    faces = box(1, 1, 1).faces
    return joined(*[Mesh(corners + cell, faces) for cell in cells])
