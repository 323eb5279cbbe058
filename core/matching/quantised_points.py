"""Embedded points in bytes: samples in 16 bits, and other points as their offsets from samples in 8 bits.

A point is near its sample, so 8 bits of its offset are as precise as 11 of a coordinate. Units are powers of
two, those of offsets no finer than those of samples: rounded coordinates come back exactly from their bytes.
Samples without other points may be dense, as those of the paper's setting, and are not rounded.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Int32s
from core.embedding import Embedding

HEAD = 3
"""Numbers before the arrays, int32: d points, m samples and c columns."""

SAMPLE_BITS, OFFSET_BITS = 15, 7
"""The largest whole number of a sample, and of an offset, is below 2 to this power."""

LEAST_EXPONENT, LARGEST_UNIT = -100, 2.0**100
"""Units are at least 2 to this power and below this number, so that quotients and products are finite; so are
samples in float32."""


class EmbeddedPoints(NamedTuple):
    """The points of an embedding record: the fingerprint of its parameters, and bytes of `encoded_points`.

    Their columns are those of so many spectral domains of one width.
    """

    fingerprint: str
    domains: int
    data: bytes


def quantised_points(embedding: Embedding) -> bytes:
    """Return the embedded points of a shape, in b spectral domains of k dimensions, as `encoded_points`."""
    clouds = [spectrum.coordinates for spectrum in embedding.spectra]
    return encoded_points(np.concatenate(clouds, axis=1), embedding.regions)


def encoded_points(coordinates: Float32s, regions: Int32s) -> bytes:
    """Return points as bytes, a multiple of four: 13 kB for 100 samples and 400 points in 20 columns.

    The numbers of `HEAD`; units of the samples and of the offsets, float32, shape (2, c); the samples over
    their units, int16, shape (m, c); the regions of the other points, uint16, shape (d - m,); their offsets
    from these samples over their units, int8, shape (d - m, c); zero bytes. Without other points the samples
    are float32, and the units, 1, are not read.

    Parameters
    ----------
    coordinates : float32, shape (d, c)
        Finite; the samples first.
    regions : int32, shape (d,)
        The sample nearest to each point.
    """
    m = int(regions.max()) + 1
    kind = _kind(len(coordinates), m)
    units, samples = np.ones(coordinates.shape[1], dtype=np.float32), coordinates[:m]
    if kind is np.int16:
        units = _units(samples, SAMPLE_BITS)
        samples = _whole(samples, units, SAMPLE_BITS)
    offsets = coordinates[m:] - (samples * units)[regions[m:]]
    offset_units = np.maximum(_units(offsets, OFFSET_BITS), units)
    arrays: tuple[NDArray[np.generic], ...] = (
        np.array([len(coordinates), m, coordinates.shape[1]], dtype=np.int32),
        units,
        offset_units,
        samples.astype(kind),
        regions[m:].astype(np.uint16),
        _whole(offsets, offset_units, OFFSET_BITS).astype(np.int8),
    )
    data = b"".join(array.tobytes() for array in arrays)
    return data + bytes(-len(data) % 4)


def decoded_points(data: bytes) -> tuple[Float32s, Int32s]:
    """Return the coordinates, shape (d, c), and the regions, shape (d,), of `encoded_points`.

    Raise ValueError for other bytes, a coordinate that is not finite, or a region of no sample.
    """
    d, m, columns = np.frombuffer(data, np.int32, HEAD).tolist()
    if not (1 <= m <= d and columns >= 1):
        raise ValueError(f"{d} points of {m} samples in {columns} columns")
    length = 4 * HEAD + (8 + np.dtype(_kind(d, m)).itemsize * m) * columns + (d - m) * (2 + columns)
    if len(data) != length + -length % 4:
        raise ValueError(f"{len(data)} bytes of {length}")
    start = 4 * HEAD
    units = np.frombuffer(data, np.float32, 2 * columns, start).reshape(2, columns)
    start += units.nbytes
    samples = np.frombuffer(data, _kind(d, m), m * columns, start).reshape(m, columns)
    start += samples.nbytes
    regions = np.frombuffer(data, np.uint16, d - m, start).astype(np.int32)
    start += 2 * (d - m)
    offsets = np.frombuffer(data, np.int8, (d - m) * columns, start).reshape(d - m, columns)
    if len(regions) and not regions.max() < m:
        raise ValueError("regions has an index out of range")
    if not ((np.abs(units) < LARGEST_UNIT).all() and (np.abs(samples) < LARGEST_UNIT).all()):
        raise ValueError("coordinates has a number that is not finite")
    if d > m:
        samples = samples * units[0]
    coordinates = np.concatenate([samples, samples[regions] + offsets * units[1]])
    return coordinates, np.concatenate([np.arange(m, dtype=np.int32), regions])


def rounded(coordinates: Float32s, regions: Int32s) -> Float32s:
    """Return coordinates as they come back from `encoded_points`, shape (d, c)."""
    return decoded_points(encoded_points(coordinates, regions))[0]


def _kind(d: int, m: int) -> type[np.int16] | type[np.float32]:
    """Return the type of the m samples of d points."""
    return np.int16 if d > m else np.float32


def _units(values: Float32s, bits: int) -> Float32s:
    """Return the least powers of two that bring each column below 2^bits, shape (c,)."""
    largest = np.abs(values).max(axis=0, initial=0.0)
    exponents = np.where(largest > 0.0, np.frexp(largest)[1] - bits, LEAST_EXPONENT)
    return np.ldexp(np.float32(1.0), np.maximum(exponents, LEAST_EXPONENT))


def _whole(values: Float32s, units: Float32s, bits: int) -> Float32s:
    """Return values over their units, rounded, of magnitude below 2^bits."""
    largest = 2**bits - 1
    return np.asarray(np.clip(np.rint(values / units), -largest, largest))
