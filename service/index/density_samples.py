"""The samples of collections in which local densities are measured, and the densities found so far."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Ints
from core.descriptors.registry import ShapeDescriptors
from core.ranking.local_density import DensitySample, LocalDensities, densities_in
from service.index.cache import EmbeddingCache

SAMPLE = 512
"""Number of shapes in a sample; smaller collections are sampled whole."""

COLLECTIONS, DENSITIES = 32, 50_000
"""Numbers of collections whose samples a pipeline keeps, of about 2 MB each, and of densities in each."""

PRIME, FIRST, SECOND = 2**31 - 1, 1_103_515_245, 654_435_761
"""Keys of the hash of shape numbers. Products of two numbers below the prime fit 64 bits, in SQL too."""


def sampled(shapes: Ints) -> Ints:
    """Return indices of the shapes of a sample, shape (min(n, SAMPLE),): those of least hash, ascending.

    `shapes` has the n numbers of the shapes of a collection. The hash depends on the number alone, so a set
    of shapes has the same sample in every process, and at most one sampled shape changes when a shape is
    stored or deleted.
    """
    if len(shapes) <= SAMPLE:
        return np.argsort(shapes)
    short = shapes % PRIME
    hashes = (short * short % PRIME * FIRST + short * SECOND) % PRIME
    last = np.partition(hashes, SAMPLE - 1)[SAMPLE - 1]
    least = np.flatnonzero(hashes <= last)
    order = np.lexsort((shapes[least], hashes[least]))[:SAMPLE]
    return np.asarray(np.sort(least[order]))


class CollectionSample:
    """The sample of a collection, with the densities that were measured in it.

    `embeddings` has the numbers of the embeddings of the sampled shapes, shape (m,). The density sample has
    the descriptors of those that can be read.
    """

    def __init__(self, embeddings: Ints, sample: DensitySample) -> None:
        self.embeddings = embeddings
        self._sample = sample
        # Each is a function of the embedding and the sample alone.
        self._densities: EmbeddingCache[tuple[float, float]] = EmbeddingCache(DENSITIES, lambda _: 1)

    def of_query(self, query: ShapeDescriptors) -> LocalDensities:
        """Return the densities of one shape, arrays of shape (1,)."""
        return densities_in(self._sample, [query])

    def of_stored(self, embeddings: Sequence[int], shapes: Sequence[ShapeDescriptors]) -> LocalDensities:
        """Return the densities of c stored shapes, shape (c,) each, by the numbers of their embeddings."""
        known = self._densities.get(embeddings)
        new = {number: shape for number, shape in zip(embeddings, shapes, strict=True) if number not in known}
        if new:
            measured = densities_in(self._sample, list(new.values()))
            pairs = zip(measured.spectral.tolist(), measured.view.tolist(), strict=True)
            for number, densities in zip(new, pairs, strict=True):
                known[number] = densities
                self._densities.put(number, densities)
        both = np.array([known[number] for number in embeddings]).reshape(len(embeddings), 2)
        return LocalDensities(both[:, 0], both[:, 1])
