"""The bounding boxes of a surface: the least one, and the one along the axes of its file."""

from math import floor, log10
from operator import itemgetter

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, compiled_for_reading

Sides = tuple[float, float, float]
"""Three lengths in the units of the file."""

FACETS, EDGES, REFINED = 16, 12, 8
"""Most facets of the convex hull, the largest, and edges, the longest, that boxes stand on, and number of the
least boxes that are refined."""

STEPS, LEAST_GAIN = 30, 1e-6
"""Most steps of a refinement, and the least fraction of its volume that a box loses in one of three steps."""

EQUAL_VOLUME = 5e-3
"""Volumes of boxes that differ by less than this fraction are equal, and the box with the least sum of its
sides counts: the boxes on the three sides of a triangular prism have one volume."""

PARALLEL = 1e-3
"""Edges whose angle is less, in radians, are parallel."""

THICKNESS = 1e-5
"""Added to each side, in units of the longest, before volumes are compared: that of a flat surface is 0."""

MOST_CORNERS, DIRECTIONS = 10_000, 1_000
"""Most vertices of a convex hull that give the axes: of more, the farthest in `DIRECTIONS` directions."""

DIGITS = 7
"""Significant digits of the longest side, as many as float32 coordinates have."""


def bounding_box(mesh: Mesh) -> Sides:
    """Return the length, width and height of the least box around a surface, the largest first.

    The box has the least volume (`EQUAL_VOLUME`); on 32 real models its volume is at most 1 % above the least
    that an exhaustive search finds. Every face counts, also the debris that cleaning drops; the area is > 0.
    The sides are rounded to `DIGITS` digits of the largest.
    """
    corners = _corners(mesh)
    corners -= 0.5 * corners.min(axis=0) + 0.5 * corners.max(axis=0)
    axes = least_box_axes(corners / np.abs(corners).max())
    length, width, height = sorted(_rounded(np.ptp(corners @ axes.T, axis=0)), reverse=True)
    return length, width, height


def file_box(mesh: Mesh) -> Sides:
    """Return the extents of a surface along the x, y and z axes of its file, rounded as `bounding_box`."""
    return _rounded(np.ptp(_corners(mesh), axis=0))


def _corners(mesh: Mesh) -> Floats:
    """Return the vertices that a face has."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    return mesh.vertices[used]


def _rounded(extents: Floats) -> Sides:
    decimals = DIGITS - 1 - floor(log10(extents.max()))
    x, y, z = (round(float(extent), decimals) for extent in extents)
    return x, y, z


def least_box_axes(points: Floats) -> Floats:
    """Return the axes, as rows of shape (3, 3), of the least box around points, shape (n, 3), of size 1.

    Of a first box one side is that of a facet of the convex hull, is parallel to two of its edges, or is
    across a principal axis. Then each axis of the least boxes is kept in turn, while the least rectangle
    across it gives the other two, until no volume falls.
    """
    normals = np.empty((0, 3))
    try:
        hull = ConvexHull(points)
    except QhullError:
        # The points lie in a plane, or on a line.
        pass
    else:
        normals = _normals(hull)
        points = points[hull.vertices]
    if len(points) > MOST_CORNERS:
        points = _farthest_points(points)
    normals = np.concatenate([normals, _principal_axes(points)])
    boxes = sorted((_box_across(points, normal) for normal in normals), key=itemgetter(1))
    boxes = [_refined(points, *box) for box in boxes[:REFINED]]
    most = (1.0 + EQUAL_VOLUME) * min(volume for _, volume in boxes)
    equal = [axes for axes, volume in boxes if volume <= most]
    return min(equal, key=lambda axes: float(np.ptp(points @ axes.T, axis=0).sum()))


def _normals(hull: ConvexHull) -> Floats:
    """Return the normals, shape (k, 3), of the largest facets and of planes along two long edges."""
    first, second, third = (hull.points[hull.simplices[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    # The triangles of one facet have one equation.
    equations, facet_of = np.unique(hull.equations, axis=0, return_inverse=True)
    largest = np.argsort(-np.bincount(facet_of.ravel(), weights=areas))[:FACETS]
    ends = np.unique(np.sort(hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    edges = hull.points[ends[:, 1]] - hull.points[ends[:, 0]]
    edges = edges[np.argsort(-np.linalg.norm(edges, axis=1))[:EDGES]]
    one, other = np.triu_indices(len(edges), 1)
    across = np.cross(edges[one], edges[other])
    lengths = np.linalg.norm(across, axis=1)
    apart = lengths > PARALLEL * np.linalg.norm(edges[one], axis=1) * np.linalg.norm(edges[other], axis=1)
    return np.concatenate([equations[largest, :3], across[apart] / lengths[apart, None]])


def _farthest_points(points: Floats) -> Floats:
    """Return the points that are farthest in one of `DIRECTIONS` directions, spread evenly on a sphere."""
    steps = np.arange(DIRECTIONS)
    heights = (2.0 * steps + 1.0) / DIRECTIONS - 1.0
    turns = np.pi * (1.0 + 5.0**0.5) * steps
    radii = np.sqrt(1.0 - heights**2)
    directions = np.stack([radii * np.cos(turns), radii * np.sin(turns), heights], axis=1)
    directions = directions @ _principal_axes(points)
    return np.asarray(points[np.unique([(points @ direction).argmax() for direction in directions])])


def _principal_axes(points: Floats) -> Floats:
    centred = points - points.mean(axis=0)
    return np.asarray(np.linalg.eigh(centred.T @ centred)[1].T)


def _refined(points: Floats, axes: Floats, volume: float) -> tuple[Floats, float]:
    """Return the axes and the volume of a box after least rectangles across its axes in turn."""
    unchanged = 0
    for step in range(STEPS):
        turned, turned_volume = _box_across(points, axes[step % 3])
        unchanged += 1
        if turned_volume < (1.0 - LEAST_GAIN) * volume:
            axes, volume, unchanged = turned, turned_volume, 0
        if unchanged == 3:
            break
    return axes, volume


@compiled_for_reading
def _box_across(points: Floats, axis: Floats) -> tuple[Floats, float]:
    """Return the axes, as rows, and the volume of the box on the least rectangle across an axis."""
    unit = np.zeros(3)
    unit[np.argmin(np.abs(axis))] = 1.0
    first = np.cross(axis, unit)
    first /= np.sqrt((first**2).sum())
    second = np.cross(axis, first)
    across = np.empty((len(points), 2))
    for i in range(len(points)):
        across[i, 0] = points[i, 0] * first[0] + points[i, 1] * first[1] + points[i, 2] * first[2]
        across[i, 1] = points[i, 0] * second[0] + points[i, 1] * second[1] + points[i, 2] * second[2]
    u, v = _rectangle_side(across)
    axes = np.empty((3, 3))
    axes[0] = axis
    axes[1] = u * first + v * second
    axes[2] = np.cross(axis, axes[1])
    volume = 1.0
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(len(points)):
            along = points[i, 0] * axes[k, 0] + points[i, 1] * axes[k, 1] + points[i, 2] * axes[k, 2]
            low, high = min(low, along), max(high, along)
        volume *= high - low + THICKNESS
    return axes, volume


@compiled
def _rectangle_side(points: Floats) -> tuple[float, float]:
    """Return the direction of a side of the least rectangle around points in a plane, shape (n, 2).

    One of its sides lies on an edge of the convex hull (Freeman and Shapira 1975).
    """
    count = len(points)
    x, y = points[:, 0], points[:, 1]
    # By x, and by y where x is equal.
    order = np.argsort(y)
    order = order[np.argsort(x[order], kind="mergesort")]
    # The hull counterclockwise: its lower chain from left to right, and its upper chain back.
    hull = np.empty(2 * count, dtype=np.int64)
    size = 0
    for chain in range(2):
        start = size
        for step in range(count):
            i = order[step] if chain == 0 else order[count - 1 - step]
            while size >= start + 2:
                a, b = hull[size - 2], hull[size - 1]
                if (x[b] - x[a]) * (y[i] - y[a]) > (y[b] - y[a]) * (x[i] - x[a]):
                    break
                size -= 1
            hull[size] = i
            size += 1
        size -= 1
    directions, areas, sums = np.empty((size, 2)), np.full(size, np.inf), np.empty(size)
    # The corners farthest ahead, to the left and behind move round the hull as the edge does.
    ahead, aside, behind = 0, 0, 0
    for edge in range(size):
        a, b = hull[edge], hull[(edge + 1) % size]
        length = np.hypot(x[b] - x[a], y[b] - y[a])
        if length == 0.0:
            continue
        u, v = (x[b] - x[a]) / length, (y[b] - y[a]) / length
        ahead = _farthest(x, y, hull[:size], max(ahead, edge), u, v)
        aside = _farthest(x, y, hull[:size], max(aside, ahead), -v, u)
        behind = _farthest(x, y, hull[:size], max(behind, aside), -u, -v)
        front, back, top = hull[ahead % size], hull[behind % size], hull[aside % size]
        width = (x[front] - x[back]) * u + (y[front] - y[back]) * v
        height = (y[top] - y[a]) * u - (x[top] - x[a]) * v
        directions[edge, 0], directions[edge, 1] = u, v
        areas[edge] = (width + THICKNESS) * (height + THICKNESS)
        sums[edge] = width + height
    least = areas.min()
    if least == np.inf:
        # The points are one.
        return 1.0, 0.0
    best = -1
    for edge in range(size):
        if areas[edge] <= (1.0 + EQUAL_VOLUME) * least and (best < 0 or sums[edge] < sums[best]):
            best = edge
    return directions[best, 0], directions[best, 1]


@compiled
def _farthest(x: Floats, y: Floats, hull: Ints, corner: int, u: float, v: float) -> int:
    """Return the corner, from one on round the hull, from which on the distance along a direction falls."""
    size = len(hull)
    for _ in range(size):
        a, b = hull[corner % size], hull[(corner + 1) % size]
        if (x[b] - x[a]) * u + (y[b] - y[a]) * v <= 0.0:
            break
        corner += 1
    return corner
