"""The surface on which a dense correspondence is computed: bounded in vertices, tied to the given mesh."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame
from core.mesh.simplification import simplify

MOST_VERTICES, SIMPLIFIED = 6000, 5000
"""A surface with more than `MOST_VERTICES` vertices is simplified to about `SIMPLIFIED`: time and memory of a
correspondence grow with the product of the two numbers of vertices."""


@dataclass(frozen=True, eq=False)
class WorkingSurface:
    """A surface of w vertices that stands for a mesh of n vertices.

    Attributes
    ----------
    mesh : Mesh
        The surface, clean, in its normal frame.
    unit : float
        Length 1 of the surface in units of the given mesh, > 0.
    nearest : int64, shape (n,)
        The vertex of the surface nearest to each vertex of the given mesh.
    given : int64, shape (w,)
        The vertex of the given mesh nearest to each vertex of the surface; it has a face.
    samples : int64, shape (m,)
        The vertex of the surface nearest to each sample of the embedding.
    simplified : bool
    """

    mesh: Mesh
    unit: float
    nearest: Ints
    given: Ints
    samples: Ints
    simplified: bool


def working_surface(given: Mesh, surface: Mesh, frame: NormalFrame, samples: Floats) -> WorkingSurface:
    """Return the working surface of a mesh.

    Parameters
    ----------
    given : Mesh
        As it was read, with n vertices.
    surface : Mesh
        The same, clean, in its normal frame, its holes filled, refined, perhaps simplified.
    frame : NormalFrame
        From the given mesh to the surface.
    samples : float, shape (m, 3)
        Positions of the samples of the embedding, in the frame of the given mesh.
    """
    simplified = len(surface.vertices) < len(given.vertices) and len(given.vertices) > MOST_VERTICES
    if len(surface.vertices) > MOST_VERTICES:
        surface, simplified = simplify(surface, SIMPLIFIED), True
    placed = frame.apply(given.vertices)
    used = np.zeros(len(placed), dtype=bool)
    used[given.faces.ravel()] = True
    used_vertices = np.flatnonzero(used)
    tree = cKDTree(surface.vertices)
    back = cKDTree(placed[used_vertices]).query(surface.vertices)[1]
    return WorkingSurface(
        mesh=surface,
        unit=frame.scale,
        nearest=np.asarray(tree.query(placed)[1], dtype=np.int64),
        given=used_vertices[back],
        samples=np.asarray(tree.query(frame.apply(samples))[1], dtype=np.int64),
        simplified=simplified,
    )
