"""The samples of collections in which local densities are measured, and the densities found so far."""

import threading
from collections.abc import Sequence

import numpy as np
from cachetools import LRUCache

from core.arrays import Ints
from core.descriptors.registry import ShapeDescriptors
from core.ranking.local_density import DensitySample, LocalDensities, densities_in
from service.collection import CollectionNumber

SAMPLE = 512
"""Number of shapes in a sample; smaller collections are sampled whole."""

COLLECTIONS, DENSITIES = 32, 50_000
"""Numbers of collections whose samples are kept, of about 2 MB each, and of densities kept with a sample."""

PRIME, FIRST, SECOND = 2**31 - 1, 1_103_515_245, 654_435_761
"""Keys of the hash of shape numbers. Products of two numbers below the prime fit 64 bits, in SQL too."""


def sampled(shapes: Ints) -> Ints:
    """Indices of the shapes of a sample, shape (min(n, SAMPLE),): those of least hash, ascending.

    The hash depends on the number alone, so a set of shapes has the same sample in every process, and at most
    one sampled shape changes when a shape is stored or deleted.

    Parameters
    ----------
    shapes : int64, shape (n,)
        Numbers of the shapes of a collection.
    """
    if len(shapes) <= SAMPLE:
        return np.argsort(shapes)
    short = shapes % PRIME
    hashes = (short * short % PRIME * FIRST + short * SECOND) % PRIME
    last = np.partition(hashes, SAMPLE - 1)[SAMPLE - 1]
    places = np.flatnonzero(hashes <= last)
    order = np.lexsort((shapes[places], hashes[places]))[:SAMPLE]
    return np.asarray(np.sort(places[order]))


class CollectionSample:
    """The sample of a collection, with the densities that were measured in it.

    Attributes
    ----------
    embeddings : int64, shape (m,)
        Numbers of the embeddings of the sampled shapes.

    Parameters
    ----------
    embeddings : int64, shape (m,)
    sample : DensitySample
        The descriptors of those that can be read.
    """

    def __init__(self, embeddings: Ints, sample: DensitySample) -> None:
        self.embeddings = embeddings
        self._sample = sample
        self._lock = threading.Lock()
        # Each is a function of the embedding and the sample alone.
        self._found: LRUCache[int, tuple[float, float]] = LRUCache(DENSITIES)

    def of_query(self, query: ShapeDescriptors) -> LocalDensities:
        """Return the densities of one shape, arrays of shape (1,)."""
        return densities_in(self._sample, [query])

    def of_stored(self, embeddings: Sequence[int], shapes: Sequence[ShapeDescriptors]) -> LocalDensities:
        """Return the densities of c stored shapes, shape (c,) each, by the numbers of their embeddings."""
        with self._lock:
            found = {number: self._found[number] for number in embeddings if number in self._found}
        new = {number: shape for number, shape in zip(embeddings, shapes, strict=True) if number not in found}
        if new:
            densities = densities_in(self._sample, list(new.values()))
            measured = zip(densities.spectral.tolist(), densities.view.tolist(), strict=True)
            found |= (added := dict(zip(new, measured, strict=True)))
            with self._lock:
                self._found.update(added)
        both = np.array([found[number] for number in embeddings]).reshape(len(embeddings), 2)
        return LocalDensities(both[:, 0], both[:, 1])


_Key = tuple[str, CollectionNumber]
"""A fingerprint and a collection."""


class DensitySamples:
    """The samples of the collections that were queried last, for several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: LRUCache[_Key, tuple[int, CollectionSample]] = LRUCache(COLLECTIONS)

    def get(self, fingerprint: str, collection: CollectionNumber) -> tuple[int, CollectionSample] | None:
        """Return the last sample of a collection by a pipeline, and the revision of its archive."""
        with self._lock:
            return self._kept.get((fingerprint, collection))

    def put(
        self, fingerprint: str, collection: CollectionNumber, revision: int, sample: CollectionSample
    ) -> None:
        """Keep the sample of a collection."""
        with self._lock:
            self._kept[fingerprint, collection] = revision, sample
