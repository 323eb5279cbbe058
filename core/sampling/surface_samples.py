"""Surface samples for registration: evenly spread points, and closest points on the surface."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.box_tree import closest_on_triangles
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.numerics.compilation import constant

POINTS, MOST, REPRESENTATIVES, NEIGHBOURS = 4000, 40_000, 500, 8
"""Least and largest number of sample points, number of representatives, and number of candidate faces.

Sample points find the candidate faces of a closest-point query, two for each face between the two limits: on
a fine mesh simplified to half its vertices, fewer points leave a residual of 0.005 of the square root of the
area, as large as that of another pose.
"""

R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""1 / g and 1 / g^2 with g^3 = g + 1: the R2 low-discrepancy sequence in the unit square (Roberts 2018)."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """A surface scaled to unit area, with its centroid at the origin, and its sample points.

    `unit` is the root of the area, and `centre`, shape (3,), the centroid, both in the file's units; the rows
    of `axes`, shape (3, 3), are the principal axes. `corners` of the faces, shape (f, 3, 3), and sample
    `points`, evenly spread by area, shape (p, 3), are at unit area; `faces`, shape (p,), has the face of each
    point, and `tree` finds the points.
    """

    unit: float
    centre: Floats
    axes: Floats
    corners: Floats
    points: Floats
    faces: Ints
    tree: cKDTree

    @property
    def representatives(self) -> Floats:
        """A subset of the sample points that represents the surface, shape (REPRESENTATIVES, 3)."""
        return self.points[:: len(self.points) // REPRESENTATIVES]

    def to_unit(self, points: Floats) -> Floats:
        """Transform points, shape (n, 3), from the file's units to unit area."""
        return np.asarray((points - self.centre) / self.unit)


def surface_samples(mesh: Mesh) -> SurfaceSamples:
    """Sample a mesh, at unit area; raise DegenerateMeshError if it has no area."""
    return samples_of_cleaned(clean(mesh).mesh)


def samples_of_cleaned(surface: Mesh) -> SurfaceSamples:
    """Sample a cleaned mesh, at unit area."""
    frame = normal_frame(surface)
    areas = face_areas(surface.vertices, surface.faces)
    unit = float(np.sqrt(areas.sum()))
    corners = (surface.vertices[surface.faces] - frame.centre) / unit
    count = POINTS * min(max(round(2 * len(areas) / POINTS), 1), MOST // POINTS)
    points, faces = evenly_spread(corners, areas, count)
    return SurfaceSamples(unit, frame.centre, frame.axes, corners, points, faces, cKDTree(points))


def closest_points(surface: SurfaceSamples, points: Floats) -> Floats:
    """Return the closest point of a surface to each point, at unit area, on faces of the nearest samples."""
    near = surface.faces[surface.tree.query(points, k=NEIGHBOURS)[1]]
    return closest_on_triangles(surface.corners, near, points)


def evenly_spread(corners: Floats, areas: Floats, count: int) -> tuple[Floats, Ints]:
    """Return points spread by area on faces of given corners, shape (count, 3), and the face of each."""
    shares, faces = evenly_spread_shares(areas, count)
    return np.einsum("pc,pcx->px", shares, corners[faces]), faces


def evenly_spread_shares(areas: Floats, count: int) -> tuple[Floats, Ints]:
    """Return barycentric coordinates of points spread by area, shape (count, 3), and their faces."""
    total = np.cumsum(areas)
    wanted = (np.arange(count) + 0.5) / count * total[-1]
    return _r2_shares(count), np.minimum(np.searchsorted(total, wanted), len(areas) - 1)


@lru_cache(maxsize=4)
def _r2_shares(count: int) -> Floats:
    """Return the barycentric coordinates of the R2 sequence, shape (count, 3)."""
    order = np.arange(count)
    steps = (0.5 + order * step for step in R2_STEPS)
    u, v = (multiples - np.floor(multiples) for multiples in steps)
    root = np.sqrt(u)
    return constant(np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1))
