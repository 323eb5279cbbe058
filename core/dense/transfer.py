"""Points, curves and values carried from one surface to another by their correspondence.

A point has a place on a triangle of the first surface, and there a row of functions, between those of the
corners. The partner is the place of the nearest row on the triangles about the nearest vertex of the second
surface, as in the maps of Ezuz and Ben-Chen, "Deblurring and denoising of maps between shapes" (2017).
Where the surfaces are rigid copies, the partner is the nearest point after the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.dense.dense_correspondence import SurfaceMap
from core.dense.functional_maps import nearest_both_ways
from core.dense.working_surface import Places, WorkingSurface
from core.errors import ParameterError
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import geodesic_distances
from core.registration.similarity import NEAR

OFF_SURFACE = 0.1
"""Largest distance of a given point from the surface, over the root of the area."""

SPACING, PIECES = 0.02, 4000
"""Length of the pieces into which curves are cut, over the root of the area, and about their number."""


MEASURED = 64
"""The most points whose distances from each other are measured."""


class OffSurfaceError(ParameterError):
    """A given point is far from the surface: its kind, shape, index from 0, distance and the largest one."""

    def __init__(self, what: str, shape: str, index: int, distance: float, most: float) -> None:
        super().__init__(what, shape, index, distance, most)
        self.what, self.shape, self.index, self.distance, self.most = what, shape, index, distance, most

    def __str__(self) -> str:
        return (
            f"{self.what} {self.index} of the {self.shape} shape is {self.distance:.4g} from the surface; "
            f"at most {self.most:.4g} is taken"
        )


@dataclass(frozen=True, eq=False)
class TransferredPoints:
    """The partners of p points.

    Attributes
    ----------
    points : float64, shape (p, 3)
        On the second given mesh, in its frame and units.
    confidence : float64, shape (p,)
        As in `core.embedding.DenseCorrespondence`.
    """

    points: Floats
    confidence: Floats


def check_on_surface(surface: WorkingSurface, points: Floats, what: str, shape: str) -> None:
    """Raise OffSurfaceError for the first of p points, shape (p, 3), that is far from a surface."""
    far = np.linalg.norm(surface.points(surface.places(points)) - points, axis=1)
    most = OFF_SURFACE * surface.root_of_area
    if not (far <= most).all():
        index = int(np.argmin(far <= most))
        raise OffSurfaceError(what, shape, index, float(far[index]), most)


def transferred_points(map_: SurfaceMap, points: Floats) -> TransferredPoints:
    """Return the partners of points on or near the first given mesh, in its frame, shape (p, 3)."""
    first, second = map_.surfaces
    places = first.places(points)
    corners = first.mesh.faces[places.faces]
    rows = np.einsum("pc,pck->pk", places.shares, map_.rows[0][corners])
    nearest = nearest_both_ways(rows, map_.rows[1])[0]
    partners = second.points(_nearest_on_triangles(rows, map_.rows[1], second.mesh.faces, nearest))
    confidence = np.einsum("pc,pc->p", places.shares, map_.partners[0].confidence[corners])
    if map_.motion is not None:
        moved = map_.motion.apply(points)
        gaps = np.linalg.norm(second.points(second.places(moved)) - moved, axis=1) / second.root_of_area
        coincide = gaps <= NEAR
        partners = np.where(coincide[:, None], moved, partners)
        confidence = np.where(coincide, 1.0 - 0.5 * gaps / NEAR, confidence)
    vertices = corners[np.arange(len(corners)), places.shares.argmax(axis=1)]
    partnered = map_.partners[0].partnered[vertices]
    return TransferredPoints(second.on_original(partners), np.where(partnered, confidence, 0.0))


def _nearest_on_triangles(rows: Floats, functions: Floats, faces: Ints, nearest: Ints) -> Places:
    """Return the places nearest to p rows on the triangles about a vertex each.

    `rows` has shape (p, k), `functions` (m, k), `faces` (f, 3) and `nearest` (p,).
    """
    order = np.argsort(faces.ravel(), kind="stable")
    starts = np.searchsorted(faces.ravel()[order], np.arange(len(functions) + 1))
    places = Places(np.empty(len(rows), dtype=np.int64), np.empty((len(rows), 3)))
    for i, vertex in enumerate(nearest):
        about = order[starts[vertex] : starts[vertex + 1]] // 3
        corners = functions[faces[about]]
        shares, squares = _closest_shares(corners - rows[i])
        best = int(squares.argmin())
        places.faces[i], places.shares[i] = about[best], shares[best]
    return places


def _closest_shares(corners: Floats) -> tuple[Floats, Floats]:
    """Return the barycentric coordinates of the points of triangles nearest to the origin, and their squares.

    The corners of q triangles in k dimensions have shape (q, 3, k), the results (q, 3) and (q,).
    """
    gram = corners @ corners.transpose(0, 2, 1)
    count = len(gram)
    candidates = np.zeros((4, count, 3))
    # The nearest point of each edge.
    for edge, (a, b) in enumerate(((0, 1), (1, 2), (2, 0))):
        length = gram[:, a, a] - 2.0 * gram[:, a, b] + gram[:, b, b]
        along = (gram[:, a, a] - gram[:, a, b]) / np.where(length > 0.0, length, 1.0)
        candidates[edge, :, b] = np.clip(along, 0.0, 1.0)
        candidates[edge, :, a] = 1.0 - candidates[edge, :, b]
    # The foot of the perpendicular on the plane, if it is inside.
    one, two, mixed = (
        gram[:, i, j] - gram[:, 0, i] - gram[:, 0, j] + gram[:, 0, 0] for i, j in ((1, 1), (2, 2), (1, 2))
    )
    right_one, right_two = gram[:, 0, 0] - gram[:, 0, 1], gram[:, 0, 0] - gram[:, 0, 2]
    determinant = one * two - mixed**2
    safe = np.where(determinant > 0.0, determinant, 1.0)
    candidates[3, :, 1] = (two * right_one - mixed * right_two) / safe
    candidates[3, :, 2] = (one * right_two - mixed * right_one) / safe
    candidates[3, :, 0] = 1.0 - candidates[3, :, 1] - candidates[3, :, 2]
    squares = np.einsum("eqa,qab,eqb->eq", candidates, gram, candidates)
    squares[3, (determinant <= 0.0) | (candidates[3].min(axis=1) < 0.0)] = np.inf
    best = squares.argmin(axis=0)
    which = np.arange(count)
    return candidates[best, which], squares[best, which]


def transferred_curves(map_: SurfaceMap, curves: Sequence[Floats]) -> list[tuple[Floats, Floats]]:
    """Return curves as they lie on the first and on the second given mesh, shapes (r, 3), in their frames.

    A curve, shape (q, 3) with q >= 2, is a polyline near the first mesh. It is cut into pieces of about
    `SPACING`, and their ends are brought to the surface.
    """
    if not curves:
        return []
    first = map_.surfaces[0]
    lengths = [np.linalg.norm(np.diff(curve, axis=0), axis=1) for curve in curves]
    spacing = max(SPACING * first.root_of_area, sum(float(each.sum()) for each in lengths) / PIECES)
    cut = [_cut(curve, spacing) for curve in curves]
    ours = first.on_original(np.concatenate(cut))
    theirs = transferred_points(map_, ours).points
    ends = np.cumsum([len(points) for points in cut])[:-1]
    return list(zip(np.split(ours, ends), np.split(theirs, ends), strict=True))


def _cut(curve: Floats, spacing: float) -> Floats:
    """Return a polyline with points on its segments, at most a spacing apart."""
    lengths = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(lengths / spacing)).astype(np.int64)
    at = np.concatenate([start + np.arange(count) / count for start, count in enumerate(pieces)])
    knots = np.arange(len(curve))
    return np.stack([np.interp(np.append(at, len(curve) - 1), knots, axis) for axis in curve.T], axis=1)


def curve_length(points: Floats) -> float:
    """Return the length of a polyline, shape (r, 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def distances_between(surface: WorkingSurface, points: Floats) -> tuple[Floats, Floats]:
    """Return straight distances and distances on a surface between p points, in its units, shapes (p, p).

    The points are in the frame of the given mesh. A path on the surface goes along edges, and diagonals
    across pairs of faces, from a corner of one point's triangle to a corner of the other's; so it is a few
    per cent longer than the shortest.
    """
    straight = np.linalg.norm(points[:, None] - points, axis=2)
    places = surface.places(points)
    corners = surface.mesh.faces[places.faces]
    vertices, rows = np.unique(corners, return_inverse=True)
    rows = rows.reshape(corners.shape)
    between = surface.unit * geodesic_distances(edge_graph(surface.mesh), vertices)
    at = surface.frame.invert(surface.mesh.vertices[vertices])
    away = np.linalg.norm(points[:, None] - at[rows], axis=2)
    paths = away[:, :, None, None] + between[rows[:, :, None, None], rows] + away
    along = paths.min(axis=(1, 3))
    same = places.faces[:, None] == places.faces
    return straight, np.where(same, straight, np.maximum(along, straight))


@dataclass(frozen=True, eq=False)
class Wanted:
    """Points, curves and values to transfer from the first mesh, of n vertices, to the second.

    Attributes
    ----------
    points : float64, shape (p, 3)
        On or near the mesh, in its frame.
    curves : tuple of float64, shape (q, 3), q >= 2
        Polylines on or near the mesh.
    values : float64, shape (n,), or None
        A scalar for each vertex.
    """

    points: Floats
    curves: tuple[Floats, ...]
    values: Floats | None


@dataclass(frozen=True, eq=False)
class Transferred:
    """Points, curves and values on the second mesh, of m vertices, after a transfer.

    Attributes
    ----------
    points : TransferredPoints
    curves : list of two float64, shape (r, 3)
        Each curve on the first and on the second mesh.
    values : float64, shape (m,), or None
        The value of the corresponding vertex; NaN at vertices without a partner.
    distances : two of two float64, shape (p, p), or None
        Straight distances and distances on the surface, of the points on the first and on the second mesh.
        None unless there are 2 to `MEASURED` points.
    gaps : float64, shape (l,)
        Distances of the images of landmarks from their partners, in units of the second mesh.
    """

    points: TransferredPoints
    curves: list[tuple[Floats, Floats]]
    values: Floats | None
    distances: tuple[tuple[Floats, Floats], tuple[Floats, Floats]] | None
    gaps: Floats


def transfer(map_: SurfaceMap, wanted: Wanted, landmarks: tuple[Floats, Floats] | None = None) -> Transferred:
    """Transfer points, curves and values, and measure how well the map agrees with landmarks.

    Raise OffSurfaceError for a point that is far from the first mesh.
    """
    first, second = map_.surfaces
    check_on_surface(first, wanted.points, "point", "first")
    for number, curve in enumerate(wanted.curves):
        check_on_surface(first, curve, f"curve {number}, point", "first")
    points = transferred_points(map_, wanted.points)
    distances = None
    if 2 <= len(wanted.points) <= MEASURED:
        ours = first.on_original(wanted.points)
        distances = distances_between(first, ours), distances_between(second, points.points)
    values = None
    if wanted.values is not None:
        back = map_.correspondences()[1]
        values = np.where(back.partnered, wanted.values[back.vertices], np.nan)
    gaps = np.empty(0)
    if landmarks is not None:
        gaps = np.linalg.norm(transferred_points(map_, landmarks[0]).points - landmarks[1], axis=1)
    curves = transferred_curves(map_, wanted.curves)
    return Transferred(points, curves, values, distances, gaps)
