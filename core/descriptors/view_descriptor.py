"""Pose-normalised view descriptor: how a surface looks from outside, whatever its mesh.

Panoramas about the axes of three frames (PANORAMA, Papadakis et al. 2010) and a histogram over pairs of
oriented points (Wahl et al. 2003). The connectivity of the mesh is not used, so polygon soups are described
as well as closed surfaces. Rotation, reflection, scale and translation change the descriptor by rounding
only. The order of the faces and their orientation do not change it. Another order of the vertices, or another
mesh of the surface, moves the sample points.
"""

import numpy as np

from core.arrays import Bytes, Floats, Ints
from core.descriptors.pair_histogram import ORIENTED_POINTS, pair_histogram
from core.descriptors.panorama import magnitudes, panoramas
from core.descriptors.view_bytes import (
    FRAME_BYTES,
    FRAME_PANORAMAS,
    MAGNITUDE_SCALE,
    SHARE_SCALE,
    to_bytes,
)
from core.descriptors.view_frames import FRAMES, normalised_surface
from core.numerics.compilation import compiled, constant
from core.numerics.radix_sort import lexical_order
from core.sampling.surface_samples import evenly_spread_shares

POINTS = 4 * ORIENTED_POINTS
"""Number of sample points."""

PAIR_WEIGHT = 1.0 / 40.0
"""Weight of the pair histograms: they count a third as much as the panoramas in the mean of all pairs of the
Princeton benchmark and of web models. Rankings hardly change from three quarters to one and a half of it."""


def view_descriptor(vertices: Floats, faces: Ints) -> Bytes:
    """The view descriptor of a surface, shape (VIEW_BYTES,); see `core.descriptors.view_bytes`.

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
    faces = np.sort(faces, axis=1)
    faces = faces[lexical_order(*faces.T)]
    surface = normalised_surface(vertices, faces)
    shares, chosen = evenly_spread_shares(surface.areas, POINTS)
    points = np.einsum("pc,pcx->px", shares, surface.points[faces[chosen]])
    normals = surface.normals[chosen]
    maps = np.stack([panoramas(points, normals, axes) for axes in surface.frames])
    step = POINTS // ORIENTED_POINTS
    return to_bytes(magnitudes(maps), pair_histogram(points[::step], normals[::step]))


def view_distance(query: Bytes, stored: Bytes) -> Floats:
    """Distances between one descriptor and c others, shape (c,), >= 0, symmetric; 0 between equal ones.

    The sum of two terms. First, the L1 distance between the magnitudes of two panoramas, in [0, 2], averaged
    over the panoramas of a frame, in the frame where it is least. Second, `PAIR_WEIGHT` times the L1 distance
    between the square roots of the shares of pairs.

    Parameters
    ----------
    query : uint8, shape (VIEW_BYTES,)
    stored : uint8, shape (c, VIEW_BYTES)
    """
    views, pairs = _differences(constant(query), constant(stored), FRAMES, FRAME_BYTES)
    views = views.min(axis=1) / (MAGNITUDE_SCALE**2 * FRAME_PANORAMAS)
    return np.asarray(views + PAIR_WEIGHT / SHARE_SCALE * pairs)


@compiled
def _differences(query: Bytes, stored: Bytes, frames: int, width: int) -> tuple[Ints, Ints]:
    """Sums of absolute differences, of whole numbers, so their order does not matter.

    First of the squares of `width` bytes of each frame, shape (c, frames); then of all later bytes, shape
    (c,).
    """
    views = np.empty((len(stored), frames), dtype=np.int64)
    pairs = np.empty(len(stored), dtype=np.int64)
    for i in range(len(stored)):
        for frame in range(frames):
            total = np.int32(0)
            for k in range(frame * width, (frame + 1) * width):
                own, other = np.int32(query[k]), np.int32(stored[i, k])
                total += abs(own * own - other * other)
            views[i, frame] = total
        total = np.int32(0)
        for k in range(frames * width, len(query)):
            total += abs(np.int32(query[k]) - np.int32(stored[i, k]))
        pairs[i] = total
    return views, pairs
