"""What lies about the points of a surface, as bytes that two surfaces are compared by.

A. E. Johnson, M. Hebert, "Using spin images for efficient object recognition in cluttered 3D scenes", IEEE
PAMI 21(5), 1999: about a point with its normal, the surface nearby is a histogram over the distance from the
normal's line and the height along it. It changes little where a limb bends elsewhere, and not at all where a
part was cut away farther off. Which side of a face is the outer one is not asked, since files are often wrong
about it: the greater part of what is near a point counts as below it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Bytes, Floats, Ints
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, constant
from core.sampling.surface_samples import evenly_spread

POINTS, KEYPOINTS = 4000, 160
"""Points that stand for a whole surface, and how many of them have a patch."""

RADII = (0.1, 0.2, 0.4)
"""Of the balls that are looked at, over the root of the whole's area."""

RADIAL_BINS, HEIGHT_BINS = 5, 9
"""Bins from the normal's line outwards, and along it: as many below the point as above, and one about its
own height, where flat surfaces lie."""

BINS = RADIAL_BINS * HEIGHT_BINS
SPIN_IMAGE_LENGTH = len(RADII) * BINS
"""Bytes of a patch: those of each ball, the smallest first."""

BYTE_SCALE = 100.0
"""A byte is so many times the root of a share of the area of a disc, and at most 255. Squared distances
between bytes, summed over a patch, are whole numbers that single precision holds, in whatever order."""

BATCH = 8
"""How many surfaces are compared at a time."""


@dataclass(frozen=True, eq=False)
class SpinImages:
    """Those of a surface, or of one from which a share of the area is missing.

    Attributes
    ----------
    bytes : uint8, shape (k, SPIN_IMAGE_LENGTH)
    points : float64, shape (k, 3)
        What they are about, in the mesh's units.
    unit : float
        The root of the whole's area in the same.
    """

    bytes: Bytes
    points: Floats
    unit: float


def spin_images(surface: Mesh, missing: float = 0.0) -> SpinImages:
    """What lies about points spread evenly over a surface.

    Points are as dense on a part as on the whole, so that what chance adds to a bin is the same.

    Parameters
    ----------
    surface : Mesh
        Clean, with some area.
    missing : float
        The share of the whole's area that is gone, in [0, 1): there are `KEYPOINTS` times the rest of them.
    """
    areas = face_areas(surface.vertices, surface.faces)
    corners = surface.vertices[surface.faces]
    centre = corners.mean(axis=(0, 1))
    unit = float(np.sqrt(areas.sum() / (1.0 - missing)))
    count = round(POINTS * (1.0 - missing))
    points, faces = evenly_spread((corners - centre) / unit, areas, count)
    keypoints = np.linspace(0, count - 1, spin_image_count(missing)).astype(np.int64)
    about = corners[faces[keypoints]]
    normals = np.cross(about[:, 1] - about[:, 0], about[:, 2] - about[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    counts = _histograms(constant(points), constant(keypoints), constant(normals), np.array(RADII))
    shares = counts / (POINTS * np.array(RADII) ** 2)[:, None]
    told = np.minimum(np.round(BYTE_SCALE * np.sqrt(shares)), 255.0).astype(np.uint8)
    return SpinImages(
        told.reshape(len(keypoints), SPIN_IMAGE_LENGTH), points[keypoints] * unit + centre, unit
    )


def spin_image_count(missing: float) -> int:
    """How many patches a surface has of which a share is missing."""
    return round(KEYPOINTS * (1.0 - missing))


def spin_image_distances(query: Bytes, others: Sequence[Bytes]) -> Floats:
    """How far the patches of one surface are from the nearest of each of c others, and theirs from its own.

    Parameters
    ----------
    query : uint8, shape (k, SPIN_IMAGE_LENGTH)
    others : sequence of uint8, each of shape (KEYPOINTS, SPIN_IMAGE_LENGTH)

    Returns
    -------
    float64, shape (c, 2)
        Mean squared distances, >= 0: from the query, and to it. 0 between a surface and itself.
    """
    found = np.empty((len(others), 2))
    own = query.astype(np.float32)
    squares = (own**2).sum(axis=1)
    for start in range(0, len(others), BATCH):
        some = np.stack(others[start : start + BATCH]).astype(np.float32)
        products = some.reshape(-1, SPIN_IMAGE_LENGTH) @ own.T
        descriptor_distance = (
            (some**2).sum(axis=2)[:, :, None] + squares - 2.0 * products.reshape(*some.shape[:2], -1)
        )
        found[start : start + len(some), 0] = descriptor_distance.min(axis=1).mean(axis=1, dtype=np.float64)
        found[start : start + len(some), 1] = descriptor_distance.min(axis=2).mean(axis=1, dtype=np.float64)
    return found / BYTE_SCALE**2


@compiled
def _histograms(points: Floats, keypoints: Ints, normals: Floats, radii: Floats) -> Ints:
    """How many points lie in each bin of each ball about each key, shape (k, r, BINS); radii rise."""
    counts = np.zeros((len(keypoints), len(radii), RADIAL_BINS * HEIGHT_BINS), dtype=np.int64)
    squared, across, along = radii**2, RADIAL_BINS / radii, 0.5 * HEIGHT_BINS / radii
    largest = squared[-1]
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    squares, heights = np.empty(len(points)), np.empty(len(points))
    near = np.empty(len(points), dtype=np.int64)
    for k in range(len(keypoints)):
        own_x, own_y, own_z = x[keypoints[k]], y[keypoints[k]], z[keypoints[k]]
        normal_x, normal_y, normal_z = normals[k, 0], normals[k, 1], normals[k, 2]
        for p in range(len(points)):
            east, north, up = x[p] - own_x, y[p] - own_y, z[p] - own_z
            squares[p] = east * east + north * north + up * up
            heights[p] = east * normal_x + north * normal_y + up * normal_z
        found, above = 0, 0.0
        for p in range(len(points)):
            near[found] = p
            if squares[p] < largest:
                found += 1
                above += heights[p]
        outwards = -1.0 if above > 0.0 else 1.0
        for i in range(found):
            square, height = squares[near[i]], outwards * heights[near[i]]
            away = np.sqrt(max(square - height * height, 0.0))
            for r in range(len(radii) - 1, -1, -1):
                if square >= squared[r]:
                    break
                column = min(int(away * across[r]), RADIAL_BINS - 1)
                row = min(max(int(height * along[r] + 0.5 * HEIGHT_BINS), 0), HEIGHT_BINS - 1)
                counts[k, r, row * RADIAL_BINS + column] += 1
    return counts
