"""Serialization of embeddings: quantised points and all other arrays as safetensors, compressed."""

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.descriptors.facts import intrinsic_reliability
from core.descriptors.pieces import WIDTH
from core.descriptors.registry import DESCRIPTORS, ShapeDescriptors
from core.embedding import NO_ORIENTATION, Embedding, Facts, Spectrum
from core.errors import BadRecordError
from core.matching.quantised_points import EmbeddedPoints, decoded_points, quantised_points
from core.spectral.orientation import ORIENTED, ORIENTING

_ARRAYS: dict[str, tuple[type[np.generic], tuple[str | int | None, ...]]] = {
    "positions": (np.float32, ("m", 3)),
    "vertices": (np.int32, ("m",)),
    "graph_edges": (np.int32, ("e", 2)),
    "graph_lengths": (np.float32, ("e",)),
    "tree_edges": (np.int32, ("m - 1", 2)),
    "signature": (np.float32, (None,)),
    "pieces": (np.float32, (None, WIDTH)),
}
"""Type and shape of each array of an embedding: m samples, e edges, None any length above 0."""

LEVEL = 3
"""The level of Zstandard: level 9 takes four times as long and saves 2 %. Deflate is read in four times as
long as either, and saves 4 %."""

MOST_BYTES = 1 << 28
"""Most bytes of a record before compression: those of 10,000 samples are a hundredth."""

LARGEST = float(np.finfo(np.float64).max)
"""Largest number among facts."""


def embedding_to_bytes(embedding: Embedding) -> bytes:
    """Return the record of an embedding: about 38 kB, or 56 kB for an incomplete surface.

    Arrays are stored by columns, whose numbers are more alike than those of a row. Coordinates are rounded as
    `core.matching.quantised_points.rounded` does, which those of a pipeline are already. The same embedding
    always gives the same bytes.
    """
    header: dict[str, Any] = {
        "fingerprint": embedding.fingerprint,
        "facts": asdict(embedding.facts),
        "spectra": [[spectrum.name, spectrum.coordinates.shape[1]] for spectrum in embedding.spectra],
    }
    arrays: dict[str, NDArray[Any]] = {name: getattr(embedding, name) for name in _ARRAYS}
    arrays |= {name: embedding.descriptors[name] for name in DESCRIPTORS if name in embedding.descriptors}
    if embedding.orientation.size:
        header["orientation"] = True
        arrays["orientation"] = embedding.orientation
    for i, spectrum in enumerate(embedding.spectra):
        arrays[f"eigenvalues_{i}"] = spectrum.eigenvalues
    arrays["header"] = np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8)
    arrays["points"] = np.frombuffer(quantised_points(embedding), dtype=np.uint8)
    columns = {name: np.ascontiguousarray(array.T) for name, array in arrays.items()}
    return zstandard.compress(save(columns), LEVEL)


@contextmanager
def _reading() -> Iterator[None]:
    """Raise a BadRecordError for any error of reading a record."""
    try:
        yield
    except (
        SafetensorError,
        zstandard.ZstdError,
        KeyError,
        TypeError,
        ValueError,
        RecursionError,
        AttributeError,
    ) as error:
        raise BadRecordError(f"not an embedding: {error}") from error


def _uncompressed(data: bytes) -> bytes:
    # The size is known before memory is taken for it.
    if not 0 <= zstandard.frame_content_size(data) <= MOST_BYTES:
        raise ValueError("of no size, or too large")
    return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)


def _arrays(
    data: bytes, wanted: Collection[str] | None = None
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the arrays of a record, or some by name, and its header."""
    columns = load(_uncompressed(data))
    arrays = {name: each.T.copy() for name, each in columns.items() if wanted is None or name in wanted}
    return arrays, json.loads(columns["header"].tobytes())


def _facts(header: dict[str, Any]) -> Facts:
    """Return the facts in a header; raise ValueError for a value that is no number of its kind."""
    facts = Facts(**header["facts"])
    for field in fields(Facts):
        value = getattr(facts, field.name)
        good = isinstance(value, int) or (field.type is float and isinstance(value, float))
        if isinstance(value, bool) or not good or not 0 <= value <= LARGEST:
            raise ValueError(f"{field.name} is {value!r}")
    return facts


def _check(faults: Iterator[str]) -> None:
    """Raise a BadRecordError with the first of the faults."""
    for fault in faults:
        raise BadRecordError(f"not an embedding: {fault}")


def embedding_from_bytes(data: bytes) -> Embedding:
    """Return the embedding that `embedding_to_bytes` wrote.

    Raise BadRecordError if the bytes are not a record, or an array has the wrong shape or type (see
    `core.embedding.Embedding`), a value that is not finite, or an index out of range.
    """
    with _reading():
        arrays, header = _arrays(data)
        coordinates, regions = decoded_points(arrays["points"].tobytes())
        names, dimensions = zip(*header["spectra"], strict=True)
        if min(dimensions) < 1 or sum(dimensions) != coordinates.shape[1]:
            raise ValueError(f"the spectra have {dimensions} columns of {coordinates.shape[1]}")
        columns = np.split(coordinates, np.cumsum(dimensions)[:-1], axis=1)
        embedding = Embedding(
            fingerprint=header["fingerprint"],
            facts=_facts(header),
            regions=regions,
            spectra=tuple(
                Spectrum(name, arrays[f"eigenvalues_{i}"], np.ascontiguousarray(columns[i]))
                for i, name in enumerate(names)
            ),
            descriptors=_descriptors(arrays),
            orientation=arrays["orientation"] if header.get("orientation") else NO_ORIENTATION,
            **{name: arrays[name] for name in _ARRAYS},
        )
    _check(_faults(embedding))
    return embedding


def points_from_bytes(data: bytes) -> EmbeddedPoints:
    """Return the embedded points of a record.

    Raise BadRecordError if the bytes are not a record, or its spectra differ in width.
    """
    with _reading():
        arrays, header = _arrays(data, ["points"])
        widths = {width for _, width in header["spectra"]}
        if len(widths) != 1:
            raise ValueError(f"the spectra have {widths} columns")
        return EmbeddedPoints(header["fingerprint"], len(header["spectra"]), arrays["points"].tobytes())


def descriptors_from_bytes(data: bytes) -> ShapeDescriptors:
    """Return the descriptors of a record, without its embedded points.

    Raise BadRecordError if the bytes are not a record, or a fact or a descriptor is not of its kind.
    """
    with _reading():
        arrays, header = _arrays(data, ["signature", *DESCRIPTORS])
        descriptors = ShapeDescriptors(
            arrays["signature"], _descriptors(arrays), intrinsic_reliability(_facts(header))
        )
    _check(_array_faults("signature", descriptors.signature, *_ARRAYS["signature"]))
    _check(_descriptor_faults(descriptors.arrays))
    return descriptors


def _descriptors(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the descriptors among the arrays of a record; raise KeyError without one that all have."""
    return {name: arrays[name] for name, row in DESCRIPTORS.items() if name in arrays or not row.optional}


def _faults(embedding: Embedding) -> Iterator[str]:
    """Yield faults of the header and of the arrays; a later check assumes that the earlier ones passed."""
    yield from _header_faults(embedding)
    m = int(embedding.regions.max()) + 1
    e = embedding.graph_edges.shape[0] if embedding.graph_edges.ndim else 0
    lengths = {"m": m, "e": e, "m - 1": m - 1}
    for name, (dtype, shape) in _ARRAYS.items():
        wanted = tuple(lengths[length] if isinstance(length, str) else length for length in shape)
        yield from _array_faults(name, getattr(embedding, name), dtype, wanted)
    for spectrum in embedding.spectra:
        yield from _array_faults(f"{spectrum.name} eigenvalues", spectrum.eigenvalues, np.float32, (None,))
    yield from _descriptor_faults(embedding.descriptors)
    yield from _orientation_faults(embedding, m)
    for name, end in (("vertices", embedding.facts.vertices), ("graph_edges", m), ("tree_edges", m)):
        indices = getattr(embedding, name)
        if indices.size and not (indices.min() >= 0 and indices.max() < end):
            yield f"{name} has an index out of range"


def _header_faults(embedding: Embedding) -> Iterator[str]:
    if not isinstance(embedding.fingerprint, str):
        yield "the fingerprint is not text"
    names = [spectrum.name for spectrum in embedding.spectra]
    if not names or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        yield f"the spectra are {names!r}"


def _descriptor_faults(arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    for name in arrays:
        descriptor = DESCRIPTORS[name]
        shape = arrays[name].shape if arrays[name].shape in descriptor.shapes else descriptor.shapes[0]
        yield from _array_faults(name, arrays[name], descriptor.dtype, shape)


def _orientation_faults(embedding: Embedding, m: int) -> Iterator[str]:
    if embedding.orientation is not NO_ORIENTATION:
        widths = [
            spectrum.coordinates.shape[1] for spectrum in embedding.spectra if spectrum.name == ORIENTING
        ]
        k = min(ORIENTED, max(widths, default=0))
        yield from _array_faults("orientation", embedding.orientation, np.int8, (m, k * (k - 1) // 2))


def _array_faults(
    name: str, array: NDArray[Any], dtype: type[np.generic], shape: tuple[str | int | None, ...]
) -> Iterator[str]:
    """Yield faults of one array; None in the shape stands for any length above 0."""
    if array.dtype != dtype:
        yield f"{name} is of type {array.dtype}, not {np.dtype(dtype)}"
    fits = array.ndim == len(shape) and all(
        have == want or (want is None and have > 0) for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        yield f"{name} has the shape {array.shape}"
    elif array.dtype.kind == "f" and not np.isfinite(array).all():
        yield f"{name} has a number that is not finite"
