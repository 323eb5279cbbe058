"""Colours of vertices: by position, by correspondence and by difference."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from core.arrays import Floats
from core.embedding import DenseCorrespondence

_NEIGHBOURS = 3


def colours_of_points(points: Floats, format_up: Floats) -> Floats:
    """Return colours of p points by position: red, green and blue increase along x, y and z, in [0.1, 1].

    `points` have the shape (p, 3); the rotation `format_up`, shape (3, 3), turns y up.
    """
    rotated = points @ format_up.T
    low, high = rotated.min(axis=0), rotated.max(axis=0)
    extent = np.where(high > low, high - low, 1.0)
    return np.asarray(0.1 + 0.9 * (rotated - low) / extent)


def interpolate_colours(points: Floats, colours: Floats, vertices: Floats) -> NDArray[np.uint8]:
    """Interpolate colours of n vertices: means of the three nearest points by inverse squared distance.

    The result, uint8 of shape (n, 4), has red, green, blue and the opacity 255.
    """
    distances, near = KDTree(points).query(vertices, k=min(_NEIGHBOURS, len(points)))
    distances, near = distances.reshape(len(vertices), -1), near.reshape(len(vertices), -1)
    weights = 1.0 / np.maximum(distances, 1e-9 * max(float(distances.max()), 1e-300)) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    return opaque(np.clip(np.einsum("nk,nkc->nc", weights, colours[near]), 0.0, 1.0))


def opaque(colours: Floats) -> NDArray[np.uint8]:
    """Return red, green, blue and opacity 255, shape (n, 4), of colours in [0, 1]."""
    whole = np.hstack([colours, np.ones((len(colours), 1))])
    return np.asarray(np.rint(255.0 * whole), dtype=np.uint8)


Paint = Literal["correspondence", "difference"]

SCALE = (
    np.array(
        [
            (228, 229, 232),
            (253, 217, 138),
            (254, 196, 79),
            (254, 153, 41),
            (236, 112, 20),
            (204, 76, 2),
            (153, 52, 4),
            (102, 37, 6),
        ]
    )
    / 255.0
)
"""Light grey for no difference, over orange, to brown for the largest: after YlOrBr of ColorBrewer (Harrower
and Brewer 2003). It grows darker evenly, which people with and without colour blindness see alike."""

NO_PARTNER = np.array((31, 91, 255)) / 255.0
"""Blue, which people who do not see red, or green, tell from orange and brown."""

LARGEST_STRETCH = 1.0
"""End of the scale of stretch, a binary logarithm: twice as long, or half as long."""


def stretch_colours(way: DenseCorrespondence) -> Floats:
    """Return the colours of n vertices by their stretch; places without a partner are blue, shape (n, 3)."""
    values = np.abs(np.log2(way.stretch.astype(np.float64)))
    return np.where(way.partnered[:, None], scale_colours(values / LARGEST_STRETCH), NO_PARTNER)


def scale_colours(shares: Floats) -> Floats:
    """Return the colours of n shares of the end of the scale, shape (n, 3)."""
    position = np.clip(shares, 0.0, 1.0) * (len(SCALE) - 1)
    return np.stack([np.interp(position, np.arange(len(SCALE)), channel) for channel in SCALE.T], axis=1)


def correspondence_colours(
    points: Floats, format_up: Floats, back: DenseCorrespondence
) -> tuple[Floats, Floats]:
    """Colour the n vertices of the first shape by position, and the m of the second by their partners.

    Places of the second shape without a partner are grey. `points`, shape (n, 3), are the vertices of the
    first; y is up after the rotation `format_up`, shape (3, 3); `back` is from the second shape to the first.
    """
    first = colours_of_points(points, format_up)
    return first, np.where(back.partnered[:, None], first[back.vertices], 0.6)
