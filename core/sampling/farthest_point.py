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


@compiled
def _relax(
    indptr: Ints,
    indices: Ints,
    lengths: Floats,
    source: int,
    distance: Floats,
    changed: NDArray[np.bool_],
    heap_key: Floats,
    heap_node: Ints,
) -> None:
    """Lower `distance` by paths from `source` (Dijkstra), and mark the blocks of lowered vertices as changed.

    Only vertices whose distance falls are visited.
    """
    distance[source] = 0.0
    changed[source // BLOCK] = True
    heap_key[0] = 0.0
    heap_node[0] = source
    size = 1
    while size > 0:
        key = heap_key[0]
        node = heap_node[0]
        size -= 1
        last_key = heap_key[size]
        last_node = heap_node[size]
        place = 0
        while True:
            child = 2 * place + 1
            if child >= size:
                break
            if child + 1 < size and heap_key[child + 1] < heap_key[child]:
                child += 1
            if heap_key[child] >= last_key:
                break
            heap_key[place] = heap_key[child]
            heap_node[place] = heap_node[child]
            place = child
        heap_key[place] = last_key
        heap_node[place] = last_node
        if key > distance[node]:
            continue
        for edge in range(indptr[node], indptr[node + 1]):
            other = indices[edge]
            way = key + lengths[edge]
            if way < distance[other]:
                distance[other] = way
                changed[other // BLOCK] = True
                place = size
                size += 1
                while place > 0:
                    parent = (place - 1) // 2
                    if heap_key[parent] <= way:
                        break
                    heap_key[place] = heap_key[parent]
                    heap_node[place] = heap_node[parent]
                    place = parent
                heap_key[place] = way
                heap_node[place] = other


@compiled
def _select(indptr: Ints, indices: Ints, lengths: Floats, weights: Floats, first: int, samples: Ints) -> None:
    count = len(indptr) - 1
    blocks = (count + BLOCK - 1) // BLOCK
    distance = np.full(count, np.inf)
    # The largest score in each block of vertices; only changed blocks are searched again.
    largest = np.empty(blocks)
    changed = np.ones(blocks, dtype=np.bool_)
    heap_key = np.empty(len(indices) + 1)
    heap_node = np.empty(len(indices) + 1, dtype=np.int64)
    node = first
    for i in range(len(samples)):
        samples[i] = node
        _relax(indptr, indices, lengths, node, distance, changed, heap_key, heap_node)
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
    _select(
        graph.indptr.astype(np.int64), graph.indices.astype(np.int64), graph.data, weights, first, samples
    )
    return samples


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
