"""Topology of a triangulated surface: closedness, connected components, genus."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Ints


def is_closed_manifold(faces: Ints) -> bool:
    """Whether every edge joins two triangles that agree in direction, and every vertex has one fan."""
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    if (tails == heads).any():
        return False
    count = int(faces.max()) + 1
    forward = tails * count + heads
    order = np.argsort(forward)
    ordered = forward[order]
    if (ordered[1:] == ordered[:-1]).any():
        return False
    backward = heads * count + tails
    twin = np.minimum(np.searchsorted(ordered, backward), len(ordered) - 1)
    if not np.array_equal(ordered[twin], backward):
        return False
    # A half-edge leaves a corner; the twin of the half-edge arrives there from the next triangle of the fan.
    arriving = order[twin]
    following = arriving - arriving % 3 + (arriving + 1) % 3
    corners = len(tails)
    fans = coo_array((np.ones(corners), (np.arange(corners), following)), shape=(corners, corners))
    return int(connected_components(fans, directed=False)[0]) == len(np.unique(faces))


def components(faces: Ints) -> int:
    """Number of connected components, linked by shared vertices."""
    count = int(faces.max()) + 1
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return len(np.unique(labels[np.unique(faces)]))


def handles(faces: Ints) -> int:
    """Genus of a closed, connected surface: (2 - (V - E + F)) / 2, where E = 3 F / 2."""
    characteristic = len(np.unique(faces)) - len(faces) // 2
    return (2 - characteristic) // 2
