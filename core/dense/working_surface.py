"""The surface that stands for a mesh in a dense correspondence, and places on it."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.box_tree import TriangleTree, triangle_tree
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame
from core.mesh.simplification import simplify
from core.registration.similarity import Similarity, to_unit_area
from core.sampling.surface_samples import SurfaceSamples

MOST_VERTICES, SIMPLIFIED = 6000, 5000
"""A surface with more than `MOST_VERTICES` vertices is simplified to about `SIMPLIFIED`: time and memory of a
correspondence grow with the product of the two numbers of vertices."""


class Places(NamedTuple):
    """Places of p points on triangles: their faces, shape (p,), and barycentric coordinates, shape (p, 3)."""

    faces: Ints
    shares: Floats


@dataclass(frozen=True, eq=False)
class WorkingSurface:
    """A surface of w vertices that stands for a mesh of n vertices.

    Attributes
    ----------
    original : Mesh
        The given mesh.
    mesh : Mesh
        The surface, clean, in its normal frame.
    frame : NormalFrame
        From the given mesh to the surface.
    nearest : int64, shape (n,)
        The vertex of the surface nearest to each vertex of the given mesh.
    given : int64, shape (w,)
        The vertex of the given mesh nearest to each vertex of the surface; it has a face.
    samples : int64, shape (m,)
        The vertex of the surface nearest to each sample of the embedding.
    simplified : bool
    """

    original: Mesh
    mesh: Mesh
    frame: NormalFrame
    nearest: Ints
    given: Ints
    samples: Ints
    simplified: bool

    @property
    def unit(self) -> float:
        """Length 1 of the surface in units of the given mesh, > 0."""
        return self.frame.scale

    def to_unit_area(self, samples: SurfaceSamples) -> Similarity:
        """Return the transform from the given mesh to unit area; the samples are those of the surface."""
        turn, centre, scale = self.frame.axes, self.frame.centre, self.frame.scale
        return Similarity(1.0 / scale, turn, -turn @ centre / scale).then(to_unit_area(samples))

    @cached_property
    def root_of_area(self) -> float:
        """The square root of the area, in units of the given mesh, > 0."""
        return self.unit * float(np.sqrt(face_areas(self.mesh.vertices, self.mesh.faces).sum()))

    @cached_property
    def _tree(self) -> TriangleTree:
        return triangle_tree(self.mesh.vertices[self.mesh.faces])

    @cached_property
    def _original_tree(self) -> TriangleTree:
        return triangle_tree(self.original.vertices[self.original.faces])

    def places(self, points: Floats) -> Places:
        """Return the places of the surface nearest to points in the frame of the given mesh, shape (p, 3)."""
        shares, faces = self._tree.closest(self.frame.apply(points))
        return Places(faces, shares)

    def nearest_vertices(self, points: Floats) -> Ints:
        """Return the vertex nearest to each of p points in the frame of the given mesh, shape (p,)."""
        return np.asarray(cKDTree(self.mesh.vertices).query(self.frame.apply(points))[1], dtype=np.int64)

    def points(self, places: Places) -> Floats:
        """Return points of the surface in the frame of the given mesh, shape (p, 3)."""
        corners = self.mesh.vertices[self.mesh.faces[places.faces]]
        return self.frame.invert(np.einsum("pc,pcx->px", places.shares, corners))

    def on_original(self, points: Floats) -> Floats:
        """Return the point of the given mesh nearest to each of p points in its frame, shape (p, 3)."""
        shares, faces = self._original_tree.closest(points)
        corners = self.original.vertices[self.original.faces[faces]]
        return np.asarray(np.einsum("pc,pcx->px", shares, corners))


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
        original=given,
        mesh=surface,
        frame=frame,
        nearest=np.asarray(tree.query(placed)[1], dtype=np.int64),
        given=used_vertices[back],
        samples=np.asarray(tree.query(frame.apply(samples))[1], dtype=np.int64),
        simplified=simplified,
    )
