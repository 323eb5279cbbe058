"""Quantised points: spectral coordinates as whole numbers in [-127, 127], with one scale a column."""

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


def quantised_points(embedding: Embedding) -> bytes:
    """The d embedded points of a shape, in b spectral domains of k dimensions: re-ranking reads these alone.

    About 8 + 4 b k + 4 d + d b k bytes: the numbers of points and of columns, int32; a scale for each column,
    float32; the sample nearest to each point, int32; the coordinates over the scales, int8; zero bytes up to
    a multiple of four.
    """
    points = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)
    scales, whole = quantised(points)
    head = np.array(points.shape, dtype=np.int32)
    data = joined(head, scales, embedding.regions, whole).tobytes()
    return data + bytes(-len(data) % 4)
