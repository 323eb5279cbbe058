"""How far two registered surfaces are from each other, both ways, at the vertices of refined meshes.

What the first surface lacks shows on the second, and what it has in addition on itself. A difference may be
smaller than a triangle, such as a hole in the middle of a plate: meshes are refined everywhere, and again
where they differ, the edges first at which the distance may be largest. A distance changes by at most the
length of the way, so an edge of length l between vertices of distances a and b has at most (a + b + l) / 2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.arrays import Floats
from core.mesh.cleaning import merge_vertices
from core.mesh.edges import edge_lengths
from core.mesh.mesh import Mesh
from core.mesh.subdivision import edge_table, refine, split_faces
from core.registration.probed_surface import ProbedSurface
from core.registration.similarity import Similarity, to_unit_area
from core.registration.surface_fit import (
    CURVED,
    FARTHEST,
    PRECISION,
    deviating_regions,
    distances_to,
    local_deviation,
)

EVERYWHERE = 1500
"""Edges are split down to those of an even mesh with so many vertices."""

PASSES, SPLIT = 8, 800
"""Passes of the local refinement, and most edges that one splits."""

FINE = 0.02
"""Edges that are shorter than this share of the distance that they may reach are not split."""


@dataclass(frozen=True, eq=False)
class SurfaceDistances:
    """The distances of one surface from another.

    Attributes
    ----------
    mesh : Mesh
        The refined surface of n vertices, in the coordinates of its file.
    distances : float64, shape (n,)
        The distance of each vertex from the other surface after the registration, in units of this file.
    deviating : bool, shape (n,)
        Where the sampling errors of both meshes do not explain the distance: nowhere on copies.
    """

    mesh: Mesh
    distances: Floats
    deviating: NDArray[np.bool_]

    @property
    def largest(self) -> float:
        """The largest distance that sampling does not explain, 0 if there is none."""
        return float(self.distances[self.deviating].max(initial=0.0))


def surface_distances(
    shown: tuple[Mesh, Mesh], surfaces: tuple[ProbedSurface, ProbedSurface], transform: Similarity
) -> tuple[SurfaceDistances, SurfaceDistances]:
    """Return the distances of the first surface from the second, and of the second from the first.

    Parameters
    ----------
    shown : two Mesh
        The meshes to refine: those of the surfaces, or simplified ones.
    surfaces : two ProbedSurface
    transform : Similarity
        Of the first surface onto the second, in the coordinates of their files.
    """
    units = [to_unit_area(surface.samples) for surface in surfaces]
    motion = units[0].inverse.then(transform).then(units[1])
    differ = not local_deviation(*surfaces, motion).within
    first = _Refined(shown[0], surfaces[0], surfaces[1], motion, differ)
    second = _Refined(shown[1], surfaces[1], surfaces[0], motion.inverse, differ)
    for _ in range(PASSES if differ else 0):
        there, back = first.news, second.news
        first.refine(motion.invert(back))
        second.refine(motion.apply(there))
    return first.distances(), second.distances()


class _Refined:
    """A mesh at unit area, and the distances of its vertices from the other surface in the same unit."""

    def __init__(
        self, shown: Mesh, own: ProbedSurface, other: ProbedSurface, motion: Similarity, differ: bool
    ) -> None:
        self.own, self.other, self.motion, self.differ = own, other, motion, differ
        chosen, group = merge_vertices(shown.vertices)
        self.unit = to_unit_area(own.samples)
        mesh = refine(Mesh(self.unit.apply(shown.vertices[chosen]), group[shown.faces]), EVERYWHERE)
        self.vertices, self.faces = mesh.vertices, mesh.faces
        _, places, spans = distances_to(other, own.points, own.normals, own.errors, motion)
        self.regions = deviating_regions(own, places, spans)
        self.gaps, self.deviating = self._measured(self.vertices)
        # The vertices at which edges are split, and the points of the last pass that deviate.
        self.chosen = self.deviating.copy()
        self.news = self.vertices[self.deviating]

    def _measured(self, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the distances of points, and where sampling does not explain them."""
        shares, faces = self.own.curved.closest(points)
        on_surface, normals, _ = self.own.curved.at(shares, faces)
        errors = self.own.curved.errors_of(shares, faces)
        gaps, places, spans = distances_to(self.other, on_surface, normals, errors, self.motion)
        far = gaps > PRECISION + FARTHEST * spans
        by_region = self.regions[self.own.curved.regions[faces]] & (
            np.abs(places) > PRECISION + CURVED * spans
        )
        return gaps / self.motion.scale, (far | by_region) & self.differ

    def refine(self, points: Floats) -> None:
        """Split edges at vertices that deviate or were nearest to points of the other surface that deviate.

        `points`, shape (k, 3), are those that were found last.
        """
        self.chosen[cKDTree(self.vertices).query(points)[1]] = True
        edges, of_face = edge_table(self.faces)
        lengths, (start, end) = edge_lengths(self.vertices, edges), edges.T
        most = 0.5 * (self.gaps[start] + self.gaps[end] + lengths)
        coarse = np.flatnonzero((self.chosen[start] | self.chosen[end]) & (lengths > FINE * most))
        split = coarse[np.argsort(-most[coarse], kind="stable")[:SPLIT]]
        middle = np.full(len(edges), -1)
        middle[split] = len(self.vertices) + np.arange(len(split))
        added = 0.5 * (self.vertices[start[split]] + self.vertices[end[split]])
        self.vertices = np.concatenate([self.vertices, added])
        self.faces = split_faces(self.faces, middle[of_face], self.vertices)
        gaps, deviating = self._measured(added)
        self.gaps = np.concatenate([self.gaps, gaps])
        self.deviating = np.concatenate([self.deviating, deviating])
        self.chosen = np.concatenate([self.chosen, deviating])
        self.news = added[deviating]

    def distances(self) -> SurfaceDistances:
        """Return the distances in the coordinates of the file."""
        mesh = Mesh(self.unit.invert(self.vertices), self.faces)
        return SurfaceDistances(mesh, self.gaps / self.unit.scale, self.deviating)
