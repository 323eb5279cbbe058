"""Geodesic distances: shortest path lengths on the edge graph between points and samples."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

WIDTH = 0.5
"""Width of a bucket in mean edge lengths; most edges are longer, so few vertices are processed twice."""


@compiled
def _search(
    indptr: NDArray[np.uint32],
    indices: NDArray[np.uint32],
    lengths: Floats,
    width: float,
    samples: Ints,
    points: Ints,
    found: Floats,
) -> int:
    """Fill the columns of `found`, shape (d, m), by one search for each sample; return the number completed.

    The queue holds vertices in buckets of distance (Dial 1969), as linked lists in a pool of entries. The
    vertices of a bucket are processed together, and those that they lower are queued afterwards: neither loop
    has a branch that a processor cannot predict. An edge shorter than a bucket may lower a vertex that was
    already processed, which is then queued again. The result is exact to the last bit, but the work has no
    bound; a search stops when its entries fill the pool, of twice the directed edges. Unsigned numbers spare
    the test for indices counted from the end.
    """
    buckets = 1
    while buckets < int(lengths.max() / width) + 3:
        buckets *= 2
    mask = np.uint64(buckets - 1)
    one, pool = np.uint64(1), np.uint64(2 * len(indices) + 2)
    # Entries are numbered from 1; 0 ends a list.
    node_of = np.empty(pool, dtype=np.uint32)
    after = np.empty(pool, dtype=np.uint32)
    batch = np.empty(pool, dtype=np.uint32)
    distance = np.empty(len(indptr) - 1)
    processed = np.empty(len(indptr) - 1)
    for s in range(len(samples)):
        head = np.zeros(buckets, dtype=np.uint32)
        distance[:] = np.inf
        processed[:] = np.inf
        distance[samples[s]] = 0.0
        node_of[1] = samples[s]
        after[1] = 0
        head[0] = 1
        top, removed, current = np.uint64(2), np.uint64(1), np.uint64(0)
        while removed < top:
            entry = np.uint64(head[current])
            if entry == 0:
                current = (current + one) & mask
                continue
            head[current] = 0
            count = np.uint64(0)
            while entry != 0:
                node = np.uint64(node_of[entry])
                batch[count] = node
                count += np.uint64(distance[node] < processed[node])
                processed[node] = distance[node]
                removed += one
                entry = np.uint64(after[entry])
            first = top
            for i in range(count):
                node = np.uint64(batch[i])
                key = distance[node]
                processed[node] = key
                start, stop = np.uint64(indptr[node]), np.uint64(indptr[node + one])
                if top + (stop - start) >= pool:
                    return s
                for edge in range(start, stop):
                    other = np.uint64(indices[edge])
                    length = key + lengths[edge]
                    node_of[top] = other
                    top += np.uint64(length < distance[other])
                    distance[other] = min(length, distance[other])
            for added in range(first, top):
                bucket = np.uint64(np.int64(distance[np.uint64(node_of[added])] / width)) & mask
                after[added] = head[bucket]
                head[bucket] = added
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
        graph.indptr.astype(np.uint32),
        graph.indices.astype(np.uint32),
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
