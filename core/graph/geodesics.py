"""Path lengths over the mesh from a few vertices to a few others."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

WIDTH = 0.25
"""Of a bucket, in mean edges: most edges are longer, so hardly a vertex is taken out twice."""


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
    """Fill columns of `found`, shape (d, m), one search a sample; how many were done before one went astray.

    Vertices wait in buckets by their distance, `width` each (Dial 1969), as chains through a pool of entries.
    Edges shorter than a bucket may lower a vertex that has been taken out, which then waits again: the result
    is the same, to the last bit, but there is no bound on the work, so that a search stops at twice as many
    as there are vertices.
    """
    count = len(indptr) - 1
    buckets = 1
    while buckets < int(lengths.max() / width) + 3:
        buckets *= 2
    mask = buckets - 1
    # The pool's first free entry heads a chain of those that were taken out; behind `top` none was ever used.
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
    """Path lengths over the mesh from d points to m samples, shape (d, m).

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric, connected, positive lengths.
    samples, points : int64, shapes (m,) and (d,)
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
    """What `geodesics` finds, by SciPy."""
    return np.ascontiguousarray(dijkstra(graph, indices=samples)[:, points].T)


def geodesic_distances(graph: csr_array, samples: Ints) -> Floats:
    """Path lengths between the samples over the whole mesh, shape (m, m)."""
    distances = geodesics(graph, samples, samples)
    return np.asarray(np.minimum(distances, distances.T))
