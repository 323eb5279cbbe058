"""The samples of a shape, read from the bytes that `core.ranking` stores of them."""

import numpy as np

from core.arrays import Bytes, Float32s
from core.numerics.compilation import kernel

EXPONENT, LARGE = 0x7F800000, 0x7C000000
"""The bits of a float32 number's exponent, and the least exponent whose numbers times 128 are not finite."""


@kernel
def samples_of(data: Bytes, columns: int) -> Float32s:
    """The coordinates, shape (m, columns), in the bytes of quantised samples, which may have more bytes.

    m is 0 if the bytes, a multiple of four, are fewer, or a coordinate is not finite.
    """
    nothing = np.empty((0, columns), dtype=np.float32)
    start = 4 + 4 * columns
    if len(data) < start:
        return nothing
    m = np.int64(data[:4].view(np.int32)[0])
    if m < 1 or len(data) < start + m * columns:
        return nothing
    # Fast arithmetic assumes finite numbers: look at the bits.
    if ((data[4:start].view(np.int32) & EXPONENT) >= LARGE).any():
        return nothing
    scales = data[4:start].view(np.float32)
    whole = data[start : start + m * columns].view(np.int8)
    samples = np.empty((m, columns), dtype=np.float32)
    for i in range(m):
        for c in range(columns):
            samples[i, c] = np.float32(whole[i * columns + c]) * scales[c]
    return samples
