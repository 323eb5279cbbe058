"""A surface made ready for being laid onto another: evenly spread points, and the closest point to any."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame

POINTS, MOST, REPRESENTATIVES, NEIGHBOURS = 4000, 40_000, 500, 8
"""Points that the closest face is found by, at least and at most; how many of them stand for the surface; and
how many faces are looked at for each.

There are two points a face where that lies between: of a fine mesh that loses half its vertices, fewer points
would leave 0.005 of the root of the area, as much as other poses do.
"""

R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""1 / g and 1 / g^2 with g^3 = g + 1: the multiples of these fill a square evenly."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """A surface of unit area about its centroid.

    Attributes
    ----------
    unit : float
        The root of the area in the file's units: the length that is 1 here.
    centre : float64, shape (3,)
        The centroid in the file's units.
    axes : float64, shape (3, 3)
        Rows are the principal axes.
    corners : float64, shape (f, 3, 3)
        Of the faces.
    points : float64, shape (p, 3)
        Spread over the surface by area.
    faces : int64, shape (p,)
        The face that each lies on.
    tree : cKDTree
        Of the points.
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
        """Those of the points that stand for the surface, shape (REPRESENTATIVES, 3)."""
        return self.points[:: len(self.points) // REPRESENTATIVES]

    def to_unit(self, points: Floats) -> Floats:
        """Points of the file, shape (n, 3), at unit area."""
        return np.asarray((points - self.centre) / self.unit)


def surface_samples(mesh: Mesh) -> SurfaceSamples:
    """A mesh made ready.

    Raises
    ------
    DegenerateMeshError
        It has no area.
    """
    surface = clean(mesh).mesh
    frame = normal_frame(surface)
    areas = face_areas(surface.vertices, surface.faces)
    unit = float(np.sqrt(areas.sum()))
    corners = (surface.vertices[surface.faces] - frame.centre) / unit
    count = POINTS * min(max(round(2 * len(areas) / POINTS), 1), MOST // POINTS)
    points, faces = evenly_spread(corners, areas, count)
    return SurfaceSamples(unit, frame.centre, frame.axes, corners, points, faces, cKDTree(points))


def closest_points(surface: SurfaceSamples, points: Floats) -> Floats:
    """The closest point of a surface to each point, shape (n, 3), on the faces about its own."""
    near = surface.faces[surface.tree.query(points, k=NEIGHBOURS)[1]]
    on_faces = closest_on_triangles(surface.corners[near], points[:, None, :])
    squares = ((on_faces - points[:, None, :]) ** 2).sum(axis=-1)
    return np.asarray(on_faces[np.arange(len(points)), squares.argmin(axis=1)])


def closest_on_triangles(corners: Floats, points: Floats) -> Floats:
    """The closest point of each triangle, corners of shape (..., 3, 3), to a point, shape (..., 3).

    It is the foot on the plane where that lies inside, and else the closest of those on the three edges.
    """
    corners, points = np.broadcast_arrays(corners, points[..., None, :])
    sides = np.roll(corners, -1, axis=-2) - corners
    along = ((points - corners) * sides).sum(axis=-1)
    lengths = np.maximum((sides**2).sum(axis=-1), np.finfo(np.float64).tiny)
    on_sides = corners + np.clip(along / lengths, 0.0, 1.0)[..., None] * sides
    nearest = ((on_sides - points) ** 2).sum(axis=-1).argmin(axis=-1)
    best = np.take_along_axis(on_sides, nearest[..., None, None], axis=-2)[..., 0, :]
    normals = np.cross(sides[..., 0, :], sides[..., 1, :])
    left = np.cross(sides, points - corners)
    inside = ((left * normals[..., None, :]).sum(axis=-1) > 0.0).all(axis=-1)
    squares = np.maximum((normals**2).sum(axis=-1), np.finfo(np.float64).tiny)
    heights = ((points[..., 0, :] - corners[..., 0, :]) * normals).sum(axis=-1) / squares
    return np.where(inside[..., None], points[..., 0, :] - heights[..., None] * normals, best)


def evenly_spread(corners: Floats, areas: Floats, count: int) -> tuple[Floats, Ints]:
    """So many points on faces with corners of shape (f, 3, 3), and the face of each, evenly by area."""
    order = np.arange(count)
    total = np.cumsum(areas)
    wanted = (order + 0.5) / count * total[-1]
    faces = np.minimum(np.searchsorted(total, wanted), len(areas) - 1)
    u, v = (np.mod(0.5 + order * step, 1.0) for step in R2_STEPS)
    root = np.sqrt(u)
    shares = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    return np.einsum("pc,pcx->px", shares, corners[faces]), faces
