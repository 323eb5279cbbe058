"""Accessors: arrays in the buffers of a glTF file (glTF 2.0, section 3.6)."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError
from core.io.gltf_document import Document, Entry, whole

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_INDEX_TYPES = {5121, 5123, 5125}
_POSITION_TYPES = {5120, 5121, 5122, 5123, 5126}


def read_positions(document: Document, number: object, used: Ints) -> Floats:
    """Return the used positions of an accessor, decoded by KHR_mesh_quantization if they are quantised.

    A normalised integer c of b bits is c / (2^b - 1), or max(c / (2^(b-1) - 1), -1) if it is signed.

    Parameters
    ----------
    document : Document
        The file.
    number : object
        Index of the accessor in the JSON.
    used : int64, shape (n,)
        Rows, each within the accessor's count.

    Returns
    -------
    positions : float64, shape (n, 3)
    """
    accessor = document.entry("accessors", number)
    if accessor.get("type") != "VEC3" or accessor.get("componentType") not in _POSITION_TYPES:
        raise MalformedMeshError("the positions in the GLB are not vectors of three coordinates")
    raw = _read(document, accessor)[used]
    positions = raw.astype(np.float64)
    if accessor.get("normalized") is True and raw.dtype.kind in "iu":
        positions = np.maximum(positions / float(2 ** (8 * raw.itemsize - (raw.dtype.kind == "i")) - 1), -1.0)
    return positions


def read_indices(document: Document, number: object) -> Ints:
    """Return the indices of a primitive, shape (count,)."""
    accessor = document.entry("accessors", number)
    if accessor.get("type") != "SCALAR" or accessor.get("componentType") not in _INDEX_TYPES:
        raise MalformedMeshError("the indices in the GLB are not whole numbers")
    return _read(document, accessor).ravel().astype(np.int64)


def count_elements(document: Document, number: object) -> int:
    """Return the number of elements of an accessor, after a check that its buffer holds them."""
    return len(_read(document, document.entry("accessors", number)))


def _read(document: Document, accessor: Entry) -> NDArray[np.generic]:
    """Return the rows of an accessor without a copy, shape (count, width)."""
    if accessor.get("type") not in _WIDTHS or accessor.get("componentType") not in _TYPES:
        raise MalformedMeshError("an accessor of the GLB is neither of positions nor of indices")
    if "sparse" in accessor:
        raise MalformedMeshError("the GLB has sparse accessors, which are not read; export without them")
    if "bufferView" not in accessor:
        # Such an accessor means `count` zeros: a few bytes of file could allocate any amount of memory.
        raise MalformedMeshError("an accessor of the GLB has no data")
    view = document.entry("bufferViews", accessor["bufferView"])
    number = whole(view, "buffer")
    if number >= len(document.buffers):
        raise MalformedMeshError("the GLB refers to an entry of its buffers that is not there")
    start, length = whole(view, "byteOffset", 0), whole(view, "byteLength")
    kind = np.dtype(_TYPES[accessor["componentType"]])
    width = _WIDTHS[accessor["type"]]
    count, offset, row = whole(accessor, "count"), whole(accessor, "byteOffset", 0), kind.itemsize * width
    stride = whole(view, "byteStride", row)
    if stride < row or start + length > len(document.buffers[number]):
        raise MalformedMeshError("a view of the GLB does not fit its buffer")
    if count and offset + stride * (count - 1) + row > length:
        raise MalformedMeshError(
            f"an accessor of the GLB declares {count} elements, more than its data holds"
        )
    return np.ndarray(
        (count, width),
        dtype=kind,
        buffer=document.buffers[number],
        offset=start + offset,
        strides=(stride, kind.itemsize),
    )
