"""Farthest-point sampling under graph distance, with one incremental distance field."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

TIE = 1e-6
"""Scores are equal if they differ by less than this fraction of the largest. The constant is not imported: a
compiled function stores its value, and the cache of compiled code would miss a change in another file."""

BLOCK = 64
"""Number of vertices in a block; the largest score of each block is stored."""

WIDTH = 0.5
"""Width of a bucket in mean edge lengths, as in `core.graph.geodesics`."""


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
    """Lower `distance` by paths from `source`, and mark the blocks of lowered vertices as changed.

    Only vertices whose distance falls are visited, by the queue of `core.graph.geodesics`: `processed` holds
    the distances at which vertices were processed, `head` (zeros) heads the buckets, and the rows of `pool`
    are the vertices of the entries, the next entries and a batch. False if the pool does not suffice.
    """
    mask, one = np.uint64(len(head) - 1), np.uint64(1)
    node_of, after, batch = pool[0], pool[1], pool[2]
    distance[source] = 0.0
    node_of[1] = source
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
            changed[node // np.uint64(BLOCK)] = True
            start, stop = np.uint64(indptr[node]), np.uint64(indptr[node + one])
            if top + (stop - start) >= np.uint64(len(node_of)):
                return False
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
    return True


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
    """Fill `samples`, shape (m,), and return True; False if a search goes on for too long."""
    count = len(indptr) - 1
    blocks = (count + BLOCK - 1) // BLOCK
    buckets = 1
    while buckets < int(lengths.max() / width) + 3:
        buckets *= 2
    head = np.zeros(buckets, dtype=np.uint32)
    pool = np.empty((3, 2 * len(indices) + 2), dtype=np.uint32)
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
        best = 0.0
        for b in range(blocks):
            if changed[b]:
                changed[b] = False
                largest[b] = 0.0
                for v in range(b * BLOCK, min(count, (b + 1) * BLOCK)):
                    largest[b] = max(largest[b], distance[v] * weights[v])
            best = max(best, largest[b])
        least = best * (1.0 - TIE)
        b = 0
        while largest[b] < least:
            b += 1
        node = b * BLOCK
        while distance[node] * weights[node] < least:
            node += 1
    return True


def farthest_points(graph: csr_array, count: int, first: int, weights: Floats | None = None) -> Ints:
    """Weighted farthest-point sampling: each sample maximises weight times distance to the earlier samples.

    The first of equal vertices, up to `TIE`, is selected.

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric and connected, with positive lengths.
    count : int
        Number of samples, 1 to n.
    first : int
        The first sample.
    weights : float64, shape (n,), optional
        Positive; without them this is plain farthest-point sampling.

    Returns
    -------
    int64, shape (count,)
        Distinct vertices in the order of selection.
    """
    total = graph.shape[0]
    samples = np.empty(min(count, total), dtype=np.int64)
    weights = np.ones(total) if weights is None else np.ascontiguousarray(weights, dtype=np.float64)
    found = _select(
        graph.indptr.astype(np.uint32),
        graph.indices.astype(np.uint32),
        graph.data,
        WIDTH * float(graph.data.mean()),
        weights,
        first,
        samples,
    )
    return samples if found else farthest_points_reference(graph, len(samples), first, weights)


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
