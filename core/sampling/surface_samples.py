"""Surface samples for registration: evenly spread points, and closest points on the surface."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.numerics.compilation import compiled, constant

POINTS, MOST, REPRESENTATIVES, NEIGHBOURS = 4000, 40_000, 500, 8
"""Least and largest number of sample points, number of representatives, and number of candidate faces.

Sample points find the candidate faces of a closest-point query, two for each face between the two limits: on
a fine mesh simplified to half its vertices, fewer points leave a residual of 0.005 of the square root of the
area, as large as that of another pose.
"""

R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""1 / g and 1 / g^2 with g^3 = g + 1: the R2 low-discrepancy sequence in the unit square (Roberts 2018)."""

TINY = float(np.finfo(np.float64).tiny)
"""The least squared length and squared normal: a triangle may be a line or a point."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """A surface scaled to unit area, with its centroid at the origin, and its sample points.

    Attributes
    ----------
    unit : float
        Square root of the surface's area, in the file's units.
    centre : float64, shape (3,)
        The centroid, in the file's units.
    axes : float64, shape (3, 3)
        Rows are the principal axes.
    corners : float64, shape (f, 3, 3)
        Corners of the faces, at unit area.
    points : float64, shape (p, 3)
        Sample points, evenly spread by area, at unit area.
    faces : int64, shape (p,)
        The face of each sample point.
    tree : cKDTree
        Search tree of the sample points.
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
    """Sample a mesh, at unit area.

    Raises
    ------
    DegenerateMeshError
        The mesh has no area.
    """
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
    """Return the closest point of a surface to each point, on the faces of the nearest samples, shape (n, 3).

    Parameters
    ----------
    surface : SurfaceSamples
    points : float64, shape (n, 3)
        At unit area.
    """
    near = surface.faces[surface.tree.query(points, k=NEIGHBOURS)[1]]
    return closest_on_triangles(surface.corners, near, points)


def evenly_spread(corners: Floats, areas: Floats, count: int) -> tuple[Floats, Ints]:
    """Return points spread evenly by area, shape (count, 3), and the face of each, shape (count,).

    Parameters
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of the faces.
    areas : float64, shape (f,)
        Areas of the faces.
    count : int
        Number of points.
    """
    shares, faces = evenly_spread_shares(areas, count)
    return _weighted_corners(constant(shares), constant(corners), constant(faces)), faces


@compiled
def _weighted_corners(shares: Floats, corners: Floats, faces: Ints) -> Floats:
    points = np.zeros((len(faces), 3))
    for p in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                points[p, axis] += shares[p, corner] * corners[faces[p], corner, axis]
    return points


def evenly_spread_shares(areas: Floats, count: int) -> tuple[Floats, Ints]:
    """Return barycentric coordinates of points spread by area, shape (count, 3), and their faces, (count,).

    Parameters
    ----------
    areas : float64, shape (f,)
        Areas of the faces.
    count : int
        Number of points.
    """
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


def closest_on_triangles(corners: Floats, near: Ints, points: Floats) -> Floats:
    """Return the point closest to each of n points on some triangles, shape (n, 3).

    Parameters
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of the triangles.
    near : int64, shape (n, k)
        For each point, the indices of the triangles that are searched; the first of several closest ones
        counts.
    points : float64, shape (n, 3)
        Finite.
    """
    return _closest(constant(corners), constant(near), constant(points))


@compiled
def _closest(corners: Floats, near: Ints, points: Floats) -> Floats:
    closest = np.empty((len(near), 3))
    candidate, work = np.empty(3), np.empty((7, 3))
    for i in range(len(near)):
        least = np.inf
        for face in near[i]:
            _closest_on_triangle(corners[face], points[i], candidate, work)
            square = _squared_distance(candidate, points[i])
            if square < least:
                least = square
                closest[i] = candidate
    return closest


@compiled
def _closest_on_triangle(corners: Floats, point: Floats, closest: Floats, work: Floats) -> None:
    """Fill `closest`, shape (3,), with the point of one triangle, shape (3, 3), closest to a point.

    `work`, shape (7, 3), is overwritten.
    """
    sides, away, normal = work[:3], work[3:6], work[6]
    for a in range(3):
        for x in range(3):
            sides[a, x] = corners[(a + 1) % 3, x] - corners[a, x]
            away[a, x] = point[x] - corners[a, x]
    for x in range(3):
        normal[x] = _cross(sides[0], sides[1], x)
    inside = True
    for a in range(3):
        turn = 0.0
        for x in range(3):
            turn += _cross(sides[a], away[a], x) * normal[x]
        inside = inside and turn > 0.0
    if inside:
        height = _dot(away[0], normal) / max(_dot(normal, normal), TINY)
        for x in range(3):
            closest[x] = point[x] - height * normal[x]
        return
    least, on_side = np.inf, normal  # the normal is not needed any more
    for a in range(3):
        share = min(max(_dot(away[a], sides[a]) / max(_dot(sides[a], sides[a]), TINY), 0.0), 1.0)
        for x in range(3):
            on_side[x] = corners[a, x] + share * sides[a, x]
        square = _squared_distance(on_side, point)
        if square < least:
            least = square
            closest[:] = on_side


@compiled
def _cross(first: Floats, second: Floats, axis: int) -> float:
    """Return one coordinate of a cross product."""
    y, z = (axis + 1) % 3, (axis + 2) % 3
    return float(first[y] * second[z] - first[z] * second[y])


@compiled
def _dot(first: Floats, second: Floats) -> float:
    return float(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


@compiled
def _squared_distance(first: Floats, second: Floats) -> float:
    return float((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2 + (first[2] - second[2]) ** 2)
