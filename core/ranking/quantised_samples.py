"""Quantised samples: spectral coordinates as whole numbers in [-127, 127], with one scale a column."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Int8s
from core.embedding import Embedding

MOST = 127


def quantised(points: Float32s) -> tuple[Float32s, Int8s]:
    """Coordinates, shape (d, c), as scales, shape (c,), and the coordinates over them, int8, shape (d, c)."""
    scales = (np.abs(points).max(axis=0) / np.float32(MOST)).astype(np.float32)
    whole = np.rint(np.divide(points, scales, out=np.zeros_like(points), where=scales > 0.0))
    return scales, whole.astype(np.int8)


def joined(*arrays: NDArray[np.generic]) -> Bytes:
    """The bytes of arrays, one after another."""
    return np.frombuffer(b"".join(array.tobytes() for array in arrays), dtype=np.uint8)


def quantised_samples(embedding: Embedding) -> bytes:
    """The m samples of a shape, in b spectral domains of k dimensions: re-ranking reads these alone.

    About 4 + 4 b k + m b k bytes: the number of samples, int32; a scale for each column of all embedded
    points, float32; the samples' coordinates over the scales, int8; zero bytes up to a multiple of four.
    """
    scales, whole = quantised(np.concatenate([one.coordinates for one in embedding.spectra], axis=1))
    samples = int(embedding.regions.max()) + 1
    data = joined(np.array([samples], dtype=np.int32), scales, whole[:samples]).tobytes()
    return data + bytes(-len(data) % 4)
