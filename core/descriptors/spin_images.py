"""Spin images: local descriptors at keypoints of a surface, quantised to bytes.

A. E. Johnson, M. Hebert, "Using spin images for efficient object recognition in cluttered 3D scenes", IEEE
PAMI 21(5), 1999. At an oriented point, the surface inside a support ball is a histogram over the distance
from the normal line (alpha) and the height along it (beta). A spin image changes little where a limb bends
elsewhere, and not at all where a distant part was cut away. The orientation of faces is not used, since files
are often wrong about it: the normal points away from the greater part of the neighbourhood.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Bytes, Float32s, Floats, Int32s, Ints
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh, face_normals
from core.numerics.compilation import compiled, compiled_for_reading
from core.sampling.surface_samples import evenly_spread

POINTS, KEYPOINTS = 4000, 160
"""Number of sample points of a complete surface, and of its keypoints, which have a spin image."""

RADII = (0.1, 0.2, 0.4)
"""Radii of the support balls, over the square root of the area of the whole."""

RADIAL_BINS, HEIGHT_BINS = 5, 9
"""Bins over alpha, and over beta: as many below the point as above, and one at its height (flat surfaces)."""

BINS = RADIAL_BINS * HEIGHT_BINS
SPIN_IMAGE_LENGTH = len(RADII) * BINS
"""Bytes of a spin image: the bins of each support ball, the smallest ball first."""

BYTE_SCALE = 100.0
"""A byte is this factor times the square root of a bin's area over r^2, at most 255. The squared distance of
two spin images is a whole number that single precision holds exactly, in any order of summation: the squared
length of one is about BYTE_SCALE^2 times the sum of 1 / r^2 over the radii at most, a twelfth of 2^24."""

BATCH = 8
"""Number of surfaces that are compared at a time; it bounds the memory."""

FAR = np.int32(2**31 - 1)
"""More than any squared distance."""


@dataclass(frozen=True, eq=False)
class SpinImages:
    """The spin images of one surface, one a row of uint8, shape (k, SPIN_IMAGE_LENGTH).

    The keypoints, shape (k, 3), and the unit, which is the square root of the area of the whole, are in the
    mesh's units.
    """

    bytes: Bytes
    points: Floats
    unit: float


def spin_images(surface: Mesh, missing: float = 0.0) -> SpinImages:
    """Compute spin images at keypoints spread evenly over a surface.

    The sample points are as dense on a part as on the whole, so the noise of a bin is the same on both.

    Parameters
    ----------
    surface : Mesh
        Clean, with area > 0.
    missing : float
        Share of the whole's area that the surface lacks, in [0, 1). The surface has
        `spin_image_count(missing)` keypoints.
    """
    areas = face_areas(surface.vertices, surface.faces)
    corners = surface.vertices[surface.faces]
    centre = corners.mean(axis=(0, 1))
    unit = float(np.sqrt(areas.sum() / (1.0 - missing)))
    count = round(POINTS * (1.0 - missing))
    points, faces = evenly_spread((corners - centre) / unit, areas, count)
    keypoints = np.linspace(0, count - 1, spin_image_count(missing)).astype(np.int64)
    normals = face_normals(corners[faces[keypoints]])
    counts = _histograms(points, keypoints, normals, np.array(RADII))
    shares = counts / (POINTS * np.array(RADII) ** 2)[:, None]
    quantised = np.minimum(np.round(BYTE_SCALE * np.sqrt(shares)), 255.0).astype(np.uint8)
    return SpinImages(
        quantised.reshape(len(keypoints), SPIN_IMAGE_LENGTH), points[keypoints] * unit + centre, unit
    )


def spin_image_count(missing: float) -> int:
    """Return the number of spin images of a surface that lacks the share `missing` of the whole's area."""
    return round(KEYPOINTS * (1.0 - missing))


def spin_image_distances(query: Bytes, others: Sequence[Bytes]) -> Floats:
    """Compute one-sided distances between the spin images of one surface and of c others.

    Parameters
    ----------
    query : uint8, shape (k, SPIN_IMAGE_LENGTH)
    others : sequence of uint8, each of shape (KEYPOINTS, SPIN_IMAGE_LENGTH)

    Returns
    -------
    float64, shape (c, 2)
        Mean squared distance to the nearest spin image, >= 0: from the query to the other surface, and back.
        0 between a surface and itself.
    """
    distances = np.empty((len(others), 2))
    images = query.astype(np.float32)
    squares = (images**2).sum(axis=1)
    for start in range(0, len(others), BATCH):
        batch = np.stack(others[start : start + BATCH]).astype(np.float32)
        products = batch.reshape(-1, SPIN_IMAGE_LENGTH) @ images.T
        both_ways = _nearest_squares(
            products.reshape(*batch.shape[:2], -1), np.einsum("ijk,ijk->ij", batch, batch), squares
        )
        for way, least in enumerate(both_ways):
            distances[start : start + len(batch), way] = least.mean(axis=1)
    return distances / BYTE_SCALE**2


@compiled
def _nearest_squares(
    products: Float32s, other_squares: Float32s, own_squares: Float32s
) -> tuple[Int32s, Int32s]:
    """Return the least squared distances of the spin images of one surface to those of c others, and back.

    Squared distances are whole numbers, so integer minima, which SIMD computes, are exact.

    Parameters
    ----------
    products : float32, shape (c, m, k)
        Inner products of the others' spin images and the surface's.
    other_squares : float32, shape (c, m)
        Squared lengths of the others' spin images.
    own_squares : float32, shape (k,)
        Squared lengths of the surface's.

    Returns
    -------
    int32, shapes (c, k) and (c, m)
    """
    c, m, k = products.shape
    least_of_own = np.full((c, k), FAR)
    least_of_others = np.empty((c, m), dtype=np.int32)
    for other in range(c):
        for i in range(m):
            least = FAR
            length = other_squares[other, i]
            for j in range(k):
                square = np.int32((length + own_squares[j]) - np.float32(2.0) * products[other, i, j])
                least_of_own[other, j] = min(least_of_own[other, j], square)
                least = min(least, square)
            least_of_others[other, i] = least
    return least_of_own, least_of_others


@compiled_for_reading
def _histograms(points: Floats, keypoints: Ints, normals: Floats, radii: Floats) -> Ints:
    """Count points in each bin of each support ball of each keypoint, shape (k, r, BINS).

    `radii`, shape (r,), ascend.
    """
    counts = np.zeros((len(keypoints), len(radii), RADIAL_BINS * HEIGHT_BINS), dtype=np.int64)
    squared, across, along = radii**2, RADIAL_BINS / radii, 0.5 * HEIGHT_BINS / radii
    largest = squared[-1]
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    squares, heights = np.empty(len(points)), np.empty(len(points))
    near = np.empty(len(points), dtype=np.int64)
    for k in range(len(keypoints)):
        own_x, own_y, own_z = x[keypoints[k]], y[keypoints[k]], z[keypoints[k]]
        normal_x, normal_y, normal_z = normals[k, 0], normals[k, 1], normals[k, 2]
        # Distances from the keypoint, and heights along its normal.
        for p in range(len(points)):
            east, north, up = x[p] - own_x, y[p] - own_y, z[p] - own_z
            squares[p] = east * east + north * north + up * up
            heights[p] = east * normal_x + north * normal_y + up * normal_z
        # The points inside the largest ball; the normal points away from the greater part of them.
        inside_count, above = 0, 0.0
        for p in range(len(points)):
            near[inside_count] = p
            inside = squares[p] < largest
            inside_count += inside
            above += heights[p] * inside
        outwards = -1.0 if above > 0.0 else 1.0
        # A point counts in each ball that holds it, from the largest one inwards.
        for i in range(inside_count):
            square, height = squares[near[i]], outwards * heights[near[i]]
            away = np.sqrt(max(square - height * height, 0.0))
            for r in range(len(radii) - 1, -1, -1):
                if square >= squared[r]:
                    break
                column = min(int(away * across[r]), RADIAL_BINS - 1)
                row = min(max(int(height * along[r] + 0.5 * HEIGHT_BINS), 0), HEIGHT_BINS - 1)
                counts[k, r, row * RADIAL_BINS + column] += 1
    return counts
