"""Shortest paths on the edge graph by Dial's queue: geodesic distances, and farthest-point sampling.

Farthest-point sampling keeps one distance field, which each sample lowers.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

WIDTH = 0.5
"""Width of a bucket in mean edge lengths; most edges are longer, so few vertices are processed twice."""

TIE = 1e-6
"""Scores are equal if they differ by less than this fraction of the largest. The constant is not imported: a
compiled function stores its value, and the cache of compiled code would miss a change in another file."""

BLOCK = 64
"""Number of vertices in a block; the largest score of each block is stored."""


def geodesics(graph: csr_array, samples: Ints, points: Ints) -> Floats:
    """Return the shortest path lengths from d points to m samples, all of them vertices, shape (d, m), >= 0.

    The graph is symmetric and connected, with positive lengths.
    """
    between = np.empty((len(points), len(samples)))
    done = _search(*_arrays(graph), samples, points, between)
    if done < len(samples):
        between[:, done:] = geodesics_reference(graph, samples[done:], points)
    return between


def geodesics_reference(graph: csr_array, samples: Ints, points: Ints) -> Floats:
    """Reference for `geodesics`, by SciPy's Dijkstra."""
    return np.ascontiguousarray(dijkstra(graph, indices=samples)[:, points].T)


def geodesic_distances(graph: csr_array, samples: Ints) -> Floats:
    """Return the shortest path lengths between the samples, shape (m, m), symmetric."""
    distances = geodesics(graph, samples, samples)
    return np.asarray(np.minimum(distances, distances.T))


def farthest_points(graph: csr_array, count: int, first: int, weights: Floats | None = None) -> Ints:
    """Select samples after a first one, each of which maximises weight times distance to those before it.

    The first of equal vertices, up to `TIE`, is selected. The graph, shape (n, n), is symmetric and
    connected, with positive lengths; weights, shape (n,), are positive, and without them this is plain
    farthest-point sampling. Return distinct vertices in the order of selection, shape (count,), 1 <= count <=
    n.
    """
    total = graph.shape[0]
    samples = np.empty(min(count, total), dtype=np.int64)
    weights = np.ones(total) if weights is None else np.ascontiguousarray(weights, dtype=np.float64)
    complete = _select(*_arrays(graph), weights, first, samples)
    return samples if complete else farthest_points_reference(graph, len(samples), first, weights)


def farthest_points_reference(
    graph: csr_array, count: int, first: int, weights: Floats | None = None
) -> Ints:
    """Reference for `farthest_points`: one complete Dijkstra search for each sample."""
    weights = np.ones(graph.shape[0]) if weights is None else weights
    distance = np.full(graph.shape[0], np.inf)
    samples = [first]
    for _ in range(min(count, graph.shape[0]) - 1):
        distance = np.minimum(distance, dijkstra(graph, indices=samples[-1]))
        score = distance * weights
        samples.append(int(np.argmax(score >= (1.0 - TIE) * score.max())))
    return np.array(samples, dtype=np.int64)


def _arrays(graph: csr_array) -> tuple[NDArray[np.uint32], NDArray[np.uint32], Floats, float]:
    """Return the row pointers, columns and lengths of a graph, and the width of a bucket."""
    indptr, indices = graph.indptr.astype(np.uint32), graph.indices.astype(np.uint32)
    return indptr, indices, graph.data, WIDTH * float(graph.data.mean())


@compiled
def _queue(edges: int, lengths: Floats, width: float) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the heads of the buckets, a power of two, and the pool for a number of directed edges."""
    buckets = 1
    while buckets < int(lengths.max() / width) + 3:
        buckets *= 2
    return np.zeros(buckets, dtype=np.uint32), np.empty((3, 2 * edges + 2), dtype=np.uint32)


@compiled
def _search(
    indptr: NDArray[np.uint32],
    indices: NDArray[np.uint32],
    lengths: Floats,
    width: float,
    samples: Ints,
    points: Ints,
    between: Floats,
) -> int:
    """Fill the columns of `between`, shape (d, m), one for each sample; return the number completed."""
    head, pool = _queue(len(indices), lengths, width)
    count = len(indptr) - 1
    distance, processed = np.empty(count), np.empty(count)
    changed = np.empty(count // BLOCK + 1, dtype=np.bool_)
    for s in range(len(samples)):
        distance[:] = np.inf
        processed[:] = np.inf
        if not _relax(indptr, indices, lengths, width, samples[s], distance, processed, changed, head, pool):
            return s
        for p in range(len(points)):
            between[p, s] = distance[points[p]]
    return len(samples)


@compiled
def _select(
    indptr: NDArray[np.uint32],
    indices: NDArray[np.uint32],
    lengths: Floats,
    width: float,
    weights: Floats,
    first: int,
    samples: Ints,
) -> bool:
    """Fill `samples`, shape (m,); return False if a search goes on for too long."""
    count = len(indptr) - 1
    blocks = (count + BLOCK - 1) // BLOCK
    head, pool = _queue(len(indices), lengths, width)
    distance = np.full(count, np.inf)
    processed = np.full(count, np.inf)
    # The largest score in each block of vertices; only changed blocks are searched again.
    largest = np.empty(blocks)
    changed = np.ones(blocks, dtype=np.bool_)
    node = first
    for i in range(len(samples)):
        samples[i] = node
        if not _relax(indptr, indices, lengths, width, node, distance, processed, changed, head, pool):
            return False
        # The best score of each block that a path has lowered, then of all.
        best = 0.0
        for b in range(blocks):
            if changed[b]:
                changed[b] = False
                largest[b] = 0.0
                for v in range(b * BLOCK, min(count, (b + 1) * BLOCK)):
                    largest[b] = max(largest[b], distance[v] * weights[v])
            best = max(best, largest[b])
        # The first vertex whose score is the best, up to rounding.
        least = best * (1.0 - TIE)
        b = 0
        while largest[b] < least:
            b += 1
        node = b * BLOCK
        while distance[node] * weights[node] < least:
            node += 1
    return True


@compiled
def _relax(
    indptr: NDArray[np.uint32],
    indices: NDArray[np.uint32],
    lengths: Floats,
    width: float,
    source: int,
    distance: Floats,
    processed: Floats,
    changed: NDArray[np.bool_],
    head: NDArray[np.uint32],
    pool: NDArray[np.uint32],
) -> bool:
    """Lower `distance` by paths from `source`; return False if the pool does not suffice.

    The queue holds vertices in buckets of distance (Dial 1969), as linked lists in a pool of entries. The
    vertices of a bucket are processed together, and those that they lower are queued afterwards: neither loop
    has a branch that a processor cannot predict. An edge shorter than a bucket may lower a vertex that was
    already processed, which is then queued again. The result is exact to the last bit, but the work has no
    bound; a search stops when its entries fill the pool, of twice the directed edges. Unsigned numbers spare
    the test for indices counted from the end.

    `processed` holds the distances at which vertices were processed, `head` (zeros) the first entry of each
    bucket, and the rows of `pool` the vertices of the entries, the next entries and a batch. Entries are
    numbered from 1; 0 ends a list. The blocks of lowered vertices are marked in `changed`.
    """
    mask, one = np.uint64(len(head) - 1), np.uint64(1)
    node_of, after, batch = pool[0], pool[1], pool[2]
    distance[source] = 0.0
    node_of[1] = source
    after[1] = 0
    head[0] = 1
    top, removed, current = np.uint64(2), np.uint64(1), np.uint64(0)
    while removed < top:
        # The next bucket that is not empty.
        entry = np.uint64(head[current])
        if entry == 0:
            current = (current + one) & mask
            continue
        # Its vertices, each once: those lowered since they were processed last.
        head[current] = 0
        count = np.uint64(0)
        while entry != 0:
            node = np.uint64(node_of[entry])
            batch[count] = node
            count += np.uint64(distance[node] < processed[node])
            processed[node] = distance[node]
            removed += one
            entry = np.uint64(after[entry])
        # Their neighbours that they lower become entries.
        first = top
        for i in range(count):
            node = np.uint64(batch[i])
            key = distance[node]
            processed[node] = key
            changed[node // np.uint64(BLOCK)] = True
            start, stop = np.uint64(indptr[node]), np.uint64(indptr[node + one])
            if top + (stop - start) >= np.uint64(len(node_of)):
                return False
            for edge in range(start, stop):
                neighbour = np.uint64(indices[edge])
                length = key + lengths[edge]
                node_of[top] = neighbour
                top += np.uint64(length < distance[neighbour])
                distance[neighbour] = min(length, distance[neighbour])
        # The entries join the buckets of their final distances.
        for added in range(first, top):
            bucket = np.uint64(np.int64(distance[np.uint64(node_of[added])] / width)) & mask
            after[added] = head[bucket]
            head[bucket] = added
    return True
