"""Triangles of polygons: fans where they cover the polygon, otherwise a triangulation in its own plane."""

import numpy as np

from core.arrays import Floats, Ints
from core.io.checks import Limits, check_indices, within

# A triangle of a fan that lies outside its polygon by less than this share of the area of the polygon is
# an effect of rounding.
_OUTSIDE = 1e-6
# More corners would be triangulated by threads, which a confined process may not start; they stay a fan.
_MOST_CORNERS = 10_000


def triangles(corners: Ints, sizes: Ints, vertices: Floats, limits: Limits) -> Ints:
    """Cut polygons into triangles, shape (f, 3), of their own corners.

    A polygon of n corners becomes n - 2 triangles that cover it once. Where the fan around the first corner
    does that, as in every convex polygon, it is taken; any other polygon is triangulated in the plane of its
    area vector, unless it has more than 10,000 corners. It may be concave, and may have holes bridged by
    doubled edges. Polygons of fewer than three corners are left out.

    `corners`, shape (sum(sizes),), has the polygons' vertices, from 0, one polygon after another; `sizes`,
    shape (p,), their numbers of corners, >= 0; `vertices`, shape (n, 3), the positions. Raise
    MalformedMeshError if an index is outside 0 .. n - 1, and MeshTooComplexError if there are more triangles
    than faces in the limits.
    """
    check_indices(corners, len(vertices))
    if (sizes == 3).all():
        within(len(sizes), limits.faces, "triangles")
        return corners.reshape(-1, 3)
    pieces = np.maximum(sizes - 2, 0)
    within(int(pieces.sum()), limits.faces, "triangles")
    starts = np.cumsum(sizes) - sizes
    # A fan around the first corner of each polygon.
    polygon = np.repeat(np.arange(len(sizes)), pieces)
    piece = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = starts[polygon]
    fans = np.asarray(corners[np.column_stack([first, first + piece + 1, first + piece + 2])])
    # The area vectors of a fan add up to that of its polygon; one that points backwards lies outside.
    points = vertices[fans]
    areas = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    wholes = np.stack([np.bincount(polygon, axis, len(sizes)) for axis in areas.T], axis=1)
    outside = (areas * wholes[polygon]).sum(axis=1) < -_OUTSIDE * (wholes**2).sum(axis=1)[polygon]
    concave = np.unique(polygon[outside])
    ends = np.cumsum(pieces)
    # The other diagonal of a quadrilateral, or a triangulation.
    quads = concave[sizes[concave] == 4]
    for side, opposite in enumerate([(1, 2, 3), (1, 3, 0)]):
        fans[ends[quads] - 2 + side] = corners[starts[quads, None] + np.array(opposite)]
    for number in concave[(sizes[concave] > 4) & (sizes[concave] <= _MOST_CORNERS)]:
        own = corners[starts[number] : starts[number] + sizes[number]]
        fans[ends[number] - pieces[number] : ends[number]] = own[_in_plane(vertices[own], wholes[number])]
    return fans


def _in_plane(points: Floats, area: Floats) -> Ints:
    """Triangulate one polygon, shape (n, 3), in the plane across its area vector; rows of its n corners."""
    # Few files have such polygons.
    import manifold3d  # noqa: PLC0415

    axes = np.linalg.svd(area[None])[2]
    # The two axes of the plane turn counterclockwise about the area vector.
    plane = np.stack([axes[1], axes[2] * np.sign(np.linalg.det(np.stack([axes[1], axes[2], area])))])
    return np.asarray(
        manifold3d.triangulate([(points - points[0]) @ plane.T], allow_convex=False), dtype=np.int64
    )
