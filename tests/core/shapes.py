"""Surfaces of known geometry, odd ones, and the changes that leave a shape what it is."""

from functools import partial

import fast_simplification
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from core.embedding import Facts
from core.gallery import CLASSES
from core.mesh.mesh import Mesh
from tests.gallery import make_shape


def mesh_of(made):
    return Mesh(made.vertices, made.faces)


def as_trimesh(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def box(*extents):
    """Eight corners, twelve triangles, centred at the origin."""
    return mesh_of(trimesh.creation.box(extents))


def icosphere(subdivisions=3, radius=1.0):
    return mesh_of(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius))


def areas(mesh):
    """The area of each face."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def area(mesh):
    return float(areas(mesh).sum())


def volume(mesh):
    """The divergence theorem over outward triangles."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def prism(sides, height, *, radii=(1.0,)):
    """A prism without lids; its corners have these distances from the axis, in turn."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    rim = np.resize(radii, sides)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low = np.arange(sides)
    up = np.roll(low, -1)
    faces = [(low, up, up + sides), (low, up + sides, low + sides)]
    return Mesh(
        np.concatenate([np.c_[rim, np.zeros(sides)], np.c_[rim, np.full(sides, height)]]),
        np.concatenate([np.stack(corners, axis=1) for corners in faces]),
    )


def rectangle(width, height, columns, rows):
    """A flat sheet in the plane z = 0, of columns x rows cells with two triangles each."""
    x, y = np.meshgrid(np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1))
    at = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = (corner.ravel() for corner in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces)


def star(tips, height=0.4):
    """A prism over a star with tips at radius 1, centred at the origin."""
    n, sides = 2 * tips, prism(2 * tips, height, radii=(1.0, 0.45))
    i, j = np.arange(n), (np.arange(n) + 1) % n
    lids = [(j, i, np.full(n, 2 * n)), (n + i, n + j, np.full(n, 2 * n + 1))]
    vertices = np.concatenate([sides.vertices, [[0, 0, 0], [0, 0, height]]]) - [0, 0, height / 2]
    return Mesh(vertices, np.concatenate([sides.faces, *(np.stack(lid, axis=1) for lid in lids)]))


def joined(*meshes):
    """Several meshes as one, each part with its own vertices."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def soup(mesh, shrink=0.98):
    """The same faces, each with corners of its own, drawn in a little so that none touch."""
    corners = mesh.vertices[mesh.faces]
    middle = corners.mean(axis=1, keepdims=True)
    return Mesh(
        (middle + shrink * (corners - middle)).reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3)
    )


def loose_parts():
    """A table top on four legs, none of which touch."""
    legs = [shifted(box(0.1, 0.1, 0.6), (x, y, -0.4)) for x in (-0.8, 0.8) for y in (-0.4, 0.4)]
    return joined(box(2.0, 1.0, 0.1), *legs)


def blob(seed=0, subdivisions=3):
    """A bumpy ball without any symmetry."""
    ball = icosphere(subdivisions)
    waves = np.random.default_rng(seed).normal(size=(6, 3))
    radius = 1.0 + 0.12 * sum(np.sin(2.0 * ball.vertices @ wave + i) for i, wave in enumerate(waves))
    return Mesh(ball.vertices * radius[:, None] * [1.3, 1.0, 0.7], ball.faces)


def folded():
    """Three sheets that share an edge."""
    return Mesh(
        [[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.4, 0, 1], [0.6, -1, -0.5]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    )


def rotation(seed):
    return Rotation.random(random_state=seed).as_matrix()


def shifted(mesh, by):
    return Mesh(mesh.vertices + np.asarray(by, dtype=float), mesh.faces)


def scaled(mesh, factor):
    return Mesh(mesh.vertices * factor, mesh.faces)


def turned(mesh, seed):
    return Mesh(mesh.vertices @ rotation(seed).T, mesh.faces)


def vertices_shuffled(mesh, seed):
    order = np.random.default_rng(seed).permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces])


def faces_shuffled(mesh, seed):
    """Another order of the faces, each beginning at another of its corners."""
    rng = np.random.default_rng(seed)
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    steps = (rng.integers(3, size=len(faces))[:, None] + np.arange(3)) % 3
    return Mesh(mesh.vertices, np.take_along_axis(faces, steps, axis=1))


SAME_SHAPE = {
    "turned": lambda mesh: turned(mesh, 11),
    "shifted": lambda mesh: shifted(mesh, 7.0 * np.ptp(mesh.vertices, axis=0).max() * np.array([1, -2, 3])),
    "scaled": lambda mesh: scaled(mesh, 37.3),
    "vertices shuffled": lambda mesh: vertices_shuffled(mesh, 12),
    "faces shuffled": lambda mesh: faces_shuffled(mesh, 13),
    "all of these": lambda mesh: scaled(
        shifted(turned(faces_shuffled(vertices_shuffled(mesh, 14), 15), 16), (3, 1, 2)), 0.021
    ),
}
"""By name: a mesh to the same shape given otherwise."""


def subdivided(mesh):
    """Every face cut into four."""
    return mesh_of(as_trimesh(mesh).subdivide())


def decimated(mesh, kept):
    """Simplified by quadrics to about so many of its faces."""
    vertices, faces = fast_simplification.simplify(
        mesh.vertices.copy(), mesh.faces.astype(np.int32), target_reduction=1.0 - kept
    )
    return Mesh(vertices, faces)


FACTS = Facts(
    vertices=52,
    faces=100,
    area=1.0,
    volume=0.1,
    scale=0.5,
    components=1,
    merged_vertices=0,
    dropped_faces=0,
    boundary_edges=0,
    nonmanifold_edges=0,
    boundary_ratio=0.0,
)
"""Of a closed surface with 150 edges."""

GALLERY = CLASSES[:12]

MANY_KINDS = {
    **{label: partial(make_shape, label, 0) for label in GALLERY},
    "soup": lambda: soup(make_shape("spider", 0)),
    "loose parts": loose_parts,
    "box": lambda: subdivided(subdivided(box(3, 2, 1))),
    "sphere": lambda: icosphere(3),
    "sheet": lambda: rectangle(3, 2, 18, 12),
    "three sheets on an edge": lambda: subdivided(subdivided(subdivided(folded()))),
    "blob": blob,
    "two blobs": lambda: joined(blob(1, 2), shifted(blob(2, 2), (4, 0, 0))),
}
"""Twenty meshes, by what they are: articulated, closed, open, in pieces, with ties."""
