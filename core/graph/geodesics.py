"""Geodesic distances: shortest path lengths on the edge graph between points and samples."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

WIDTH = 0.25
"""Width of a bucket in mean edge lengths; most edges are longer, so few vertices are processed twice."""


@compiled
def _search(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    lengths: Floats,
    width: float,
    samples: Ints,
    points: Ints,
    found: Floats,
) -> int:
    """Fill the columns of `found`, shape (d, m), by one search for each sample; return the number completed.

    The queue holds vertices in buckets of distance (Dial 1969), as linked lists in a pool of entries. An edge
    shorter than a bucket may lower a vertex that was already processed, which is then queued again. The
    result is exact to the last bit, but the work has no bound; a search stops after processing twice as many
    entries as there are vertices.
    """
    count = len(indptr) - 1
    buckets = 1
    while buckets < int(lengths.max() / width) + 3:
        buckets *= 2
    mask = buckets - 1
    # `free` heads the list of released entries of the pool; entries from `top` on were never used.
    pool = len(indices) + 1
    node_of = np.empty(pool, dtype=np.int32)
    key_of = np.empty(pool)
    after = np.empty(pool, dtype=np.int32)
    distance = np.empty(count)
    for s in range(len(samples)):
        head = np.full(buckets, -1, dtype=np.int32)
        distance[:] = np.inf
        distance[samples[s]] = 0.0
        node_of[0] = samples[s]
        key_of[0] = 0.0
        after[0] = -1
        head[0] = 0
        free, top, waiting, current, work = -1, 1, 1, 0, 0
        while waiting > 0:
            entry = head[current]
            if entry < 0:
                current = (current + 1) & mask
                continue
            head[current] = after[entry]
            after[entry] = free
            free = entry
            waiting -= 1
            node = node_of[entry]
            key = key_of[entry]
            if key > distance[node]:
                continue
            work += 1
            if work > 2 * count:
                return s
            for edge in range(indptr[node], indptr[node + 1]):
                other = indices[edge]
                way = key + lengths[edge]
                if way < distance[other]:
                    distance[other] = way
                    if free >= 0:
                        entry = free
                        free = after[entry]
                    elif top < pool:
                        entry = top
                        top += 1
                    else:
                        return s
                    bucket = int(way / width) & mask
                    node_of[entry] = other
                    key_of[entry] = way
                    after[entry] = head[bucket]
                    head[bucket] = entry
                    waiting += 1
        for p in range(len(points)):
            found[p, s] = distance[points[p]]
    return len(samples)


def geodesics(graph: csr_array, samples: Ints, points: Ints) -> Floats:
    """Shortest path lengths from d points to m samples, shape (d, m), >= 0.

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric and connected, with positive lengths.
    samples : int64, shape (m,)
        Vertices.
    points : int64, shape (d,)
        Vertices.
    """
    found = np.empty((len(points), len(samples)))
    done = _search(
        graph.indptr.astype(np.int32, copy=False),
        graph.indices.astype(np.int32, copy=False),
        graph.data,
        WIDTH * float(graph.data.mean()),
        samples,
        points,
        found,
    )
    if done < len(samples):
        found[:, done:] = geodesics_reference(graph, samples[done:], points)
    return found


def geodesics_reference(graph: csr_array, samples: Ints, points: Ints) -> Floats:
    """Reference for `geodesics`, by SciPy's Dijkstra."""
    return np.ascontiguousarray(dijkstra(graph, indices=samples)[:, points].T)


def geodesic_distances(graph: csr_array, samples: Ints) -> Floats:
    """Shortest path lengths between the samples, shape (m, m), symmetric."""
    distances = geodesics(graph, samples, samples)
    return np.asarray(np.minimum(distances, distances.T))
