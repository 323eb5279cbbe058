"""Pose-normalised view descriptor: how a surface looks from outside, whatever its mesh.

Panoramas about the axes of three frames (PANORAMA, Papadakis et al. 2010) and a histogram over pairs of
oriented points (Wahl et al. 2003). The connectivity of the mesh is not used, so polygon soups are described
as well as closed surfaces. Rotation, reflection, scale and translation change the descriptor by rounding
only. The order of the faces and their orientation do not change it. Another order of the vertices, or another
mesh of the surface, moves the sample points.
"""

import numpy as np

from core.arrays import Bytes, Floats, Ints
from core.descriptors.panorama import CHANNELS, frequency_radii, kept, magnitudes, panoramas
from core.descriptors.view_frames import FRAMES, NormalisedSurface, normalised_surface
from core.numerics.compilation import compiled_for_reading
from core.numerics.radix_sort import lexical_order
from core.sampling.surface_samples import evenly_spread_shares

ORIENTED_POINTS = 4096
"""Number of points; a power of two."""

DISTANCE_BINS, NORMAL_BINS, ANGLE_BINS = 12, 4, 5
"""Bins over the distance, over the cosine between the normals, and over that of a normal with the line."""

ANGLE_PAIRS = ANGLE_BINS * (ANGLE_BINS + 1) // 2
"""Bins over the two cosines with the line, the larger first."""

LONGEST = 4.0
"""Distances above this number of root mean square radii count in the last bin."""

PARTNERS = 16
"""Number of other points with which each point is paired."""


def pair_histogram(points: Floats, normals: Floats) -> Floats:
    """Compute shares of point pairs, shape (DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS), of sum 1.

    There are `ORIENTED_POINTS` sample points, evenly spread by area, at a root mean square radius of 1, and
    unit normals at the points, of either sign.
    """
    counts = _pair_counts(points, normals)
    return np.asarray(counts / counts.sum())


@compiled_for_reading
def _pair_counts(points: Floats, normals: Floats) -> Floats:
    """Count the pairs (i, q i + r mod n): with q odd, each partner r pairs every point once."""
    counts = np.zeros((DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS))
    total = len(points)
    for partner in range(PARTNERS):
        factor, shift = 4 * (37 * partner + 11) + 1, 253 * partner + 127
        for first in range(total):
            second = (factor * first + shift) % total
            # The line between the points, and the cosines of the normals with it and with each other.
            x = points[second, 0] - points[first, 0]
            y = points[second, 1] - points[first, 1]
            z = points[second, 2] - points[first, 2]
            distance = np.sqrt(x * x + y * y + z * z)
            scale = 1.0 / distance if distance > 0.0 else 0.0
            cosine = abs(normals[first, 0] * x + normals[first, 1] * y + normals[first, 2] * z) * scale
            other_cosine = (
                abs(normals[second, 0] * x + normals[second, 1] * y + normals[second, 2] * z) * scale
            )
            between = abs(
                normals[first, 0] * normals[second, 0]
                + normals[first, 1] * normals[second, 1]
                + normals[first, 2] * normals[second, 2]
            )
            # Bins by distance, by the angle of the normals, and by both angles with the line.
            i = min(int(distance * (DISTANCE_BINS / LONGEST)), DISTANCE_BINS - 1)
            j = min(int(between * NORMAL_BINS), NORMAL_BINS - 1)
            larger = min(int(max(cosine, other_cosine) * ANGLE_BINS), ANGLE_BINS - 1)
            smaller = min(int(min(cosine, other_cosine) * ANGLE_BINS), ANGLE_BINS - 1)
            counts[i, j, larger * (larger + 1) // 2 + smaller] += 1.0
    return counts


FREQUENCIES = int(kept().sum())
"""Number of frequencies of a panorama."""

FRAME_PANORAMAS = 3 * CHANNELS
"""Number of panoramas of a frame."""

FRAME_BYTES = FRAME_PANORAMAS * FREQUENCIES
PANORAMA_BYTES = FRAMES * FRAME_BYTES
VIEW_BYTES = PANORAMA_BYTES + DISTANCE_BINS * NORMAL_BINS * ANGLE_PAIRS
"""Bytes of the panoramas of one frame, of those of all frames, and of a descriptor."""

MAGNITUDE_SCALE, SHARE_SCALE = 255.0, 510.0
"""A byte is this factor times the square root of a magnitude, or of a share of pairs, at most 255."""


def to_bytes(magnitudes: Floats, shares: Floats) -> Bytes:
    """Return a descriptor, shape (VIEW_BYTES,), as `magnitudes_of` and `shares_of` read it."""
    values = (MAGNITUDE_SCALE * np.sqrt(magnitudes), SHARE_SCALE * np.sqrt(shares))
    return np.concatenate([np.minimum(np.rint(some), 255.0).astype(np.uint8).ravel() for some in values])


def magnitudes_of(descriptor: Bytes) -> Floats:
    """Return magnitudes of a descriptor, shape (FRAMES, 3, CHANNELS, FREQUENCIES), up to rounding."""
    values = (descriptor[:PANORAMA_BYTES] / MAGNITUDE_SCALE) ** 2
    return values.reshape(FRAMES, 3, CHANNELS, FREQUENCIES)


def shares_of(descriptor: Bytes) -> Floats:
    """Return shares of pairs of a descriptor up to rounding, (DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS).

    Shares above 0.25 are 0.25.
    """
    values = (descriptor[PANORAMA_BYTES:] / SHARE_SCALE) ** 2
    return values.reshape(DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS)


POINTS = 4 * ORIENTED_POINTS
"""Number of sample points."""

PAIR_WEIGHT = 1.0 / 40.0
"""Weight of the pair histograms: they count a third as much as the panoramas in the mean of all pairs of the
Princeton benchmark and of web models. Rankings hardly change from three quarters to one and a half of it."""


def view_descriptor(vertices: Floats, faces: Ints) -> Bytes:
    """Return the view descriptor of a surface, shape (VIEW_BYTES,); see `core.descriptors.views`.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
        Finite, in any unit.
    faces : int64, shape (f, 3)
        Open, closed or unconnected; turned to either side.

    Raises
    ------
    DegenerateMeshError
        The surface has no area.
    """
    return describe_views(*view_surface(vertices, faces))


def view_surface(vertices: Floats, faces: Ints) -> tuple[NormalisedSurface, Ints]:
    """Return a surface in its frames, and its faces in an order that depends on the vertices alone."""
    faces = np.sort(faces, axis=1)
    faces = faces[lexical_order(*faces.T)]
    return normalised_surface(vertices, faces), faces


def describe_views(surface: NormalisedSurface, faces: Ints) -> Bytes:
    """Return the view descriptor of what `view_surface` returns."""
    shares, chosen = evenly_spread_shares(surface.areas, POINTS)
    points = np.einsum("pc,pcx->px", shares, surface.points[faces[chosen]])
    normals = surface.normals[chosen]
    maps = np.stack([panoramas(points, normals, axes) for axes in surface.frames])
    step = POINTS // ORIENTED_POINTS
    return to_bytes(magnitudes(maps), pair_histogram(points[::step], normals[::step]))


def view_distance(query: Bytes, stored: Bytes) -> Floats:
    """Compute distances between one descriptor and c others, shape (c,), >= 0; 0 between equal ones.

    The sum of two terms. First, the L1 distance between the magnitudes of two panoramas, in [0, 2], averaged
    over the panoramas of a frame, in the frame where it is least. Second, `PAIR_WEIGHT` times the L1 distance
    between the square roots of the shares of pairs.

    Parameters
    ----------
    query : uint8, shape (VIEW_BYTES,)
    stored : uint8, shape (c, VIEW_BYTES)
    """
    views, pairs = _differences(query, stored, FRAMES, FRAME_BYTES)
    views = views.min(axis=1) / (MAGNITUDE_SCALE**2 * FRAME_PANORAMAS)
    return np.asarray(views + PAIR_WEIGHT / SHARE_SCALE * pairs)


@compiled_for_reading
def _differences(query: Bytes, stored: Bytes, frames: int, width: int) -> tuple[Ints, Ints]:
    """Compute sums of absolute differences, of whole numbers, so their order does not matter.

    First of the squares of `width` bytes of each frame, shape (c, frames); then of all later bytes, shape
    (c,).
    """
    views = np.empty((len(stored), frames), dtype=np.int64)
    pairs = np.empty(len(stored), dtype=np.int64)
    for i in range(len(stored)):
        for frame in range(frames):
            total = np.int32(0)
            for k in range(frame * width, (frame + 1) * width):
                byte, stored_byte = np.int32(query[k]), np.int32(stored[i, k])
                square, stored_square = np.int32(byte * byte), np.int32(stored_byte * stored_byte)
                total = np.int32(total + abs(np.int32(square - stored_square)))
            views[i, frame] = total
        total = np.int32(0)
        for k in range(frames * width, len(query)):
            total = np.int32(total + abs(np.int32(np.int32(query[k]) - np.int32(stored[i, k]))))
        pairs[i] = total
    return views, pairs


LOWEST = frequency_radii()[kept()] < 0.35
"""The frequencies of a panorama that the signature keeps, shape (FREQUENCIES,)."""

COARSE_DISTANCES = 4
"""Number of bins over the distance between two points."""

ALIGNED = 3
"""A normal is along the line between two points from this bin of `ANGLE_BINS` on: a cosine of 0.6."""

LARGER, SMALLER = np.tril_indices(ANGLE_BINS)
ALONG = np.eye(3)[(LARGER >= ALIGNED).astype(int) + (SMALLER >= ALIGNED)]
"""Weights, shape (ANGLE_PAIRS, 3), that add up the bins of two angles: neither normal is along the line
between two points, one is, or both are."""

SIGNATURE_BYTES = 3 * CHANNELS * int(LOWEST.sum()) + COARSE_DISTANCES * NORMAL_BINS * 3

VIEW_SCALE = 1.0 / 1900.0
"""View distance over the distance of view signatures, the mean of pairs of many kinds."""

LOW_SCALE, COARSE_SCALE = 1000.0, 400.0
"""A byte is the first factor times a magnitude, or the second times the root of a share, at most 255."""


def view_signature(descriptor: Bytes) -> Bytes:
    """Return the signature, shape (SIGNATURE_BYTES,), of a descriptor, shape (VIEW_BYTES,)."""
    low = magnitudes_of(descriptor).mean(axis=0)[..., LOWEST]
    shares = shares_of(descriptor).reshape(COARSE_DISTANCES, -1, NORMAL_BINS, len(ALONG)).sum(axis=1) @ ALONG
    values = np.concatenate([LOW_SCALE * low.ravel(), COARSE_SCALE * np.sqrt(shares).ravel()])
    return np.asarray(np.minimum(np.rint(values), 255.0).astype(np.uint8))


@compiled_for_reading
def signature_distance(query: Bytes, stored: Bytes) -> Ints:
    """Compute L1 distances between one signature and c others, shape (c,).

    A sum over at most 257 bytes fits 16 bits, which takes a third of the time.
    """
    sums = np.empty(len(stored), dtype=np.int64)
    for i in range(len(stored)):
        total = np.uint16(0)
        for k in range(len(query)):
            byte, stored_byte = query[k], stored[i, k]
            total = np.uint16(
                total + np.uint16(byte - stored_byte if byte > stored_byte else stored_byte - byte)
            )
        sums[i] = total
    return sums
