"""The two chunks of a GLB, with checked access to its JSON and its accessors (glTF 2.0, section 3.6)."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import ExternalReferenceError, MalformedMeshError
from core.io.checks import shown

# A JSON object of the glTF.
Entry = dict[str, Any]

_HEADER_BYTES = 12
_CHUNK_HEADER_BYTES = 8
_SECTIONS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers", "images")
_JSON, _BINARY = b"JSON", b"BIN\0"
# Extensions that do not change positions or triangles.
_HARMLESS = (
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
)
# Component types of accessors, and values of an element.
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_INDEX_TYPES = {5121, 5123, 5125}
_POSITION_TYPES = {5120, 5121, 5122, 5123, 5126}


@dataclass(frozen=True)
class Document:
    """The content of a GLB.

    Attributes
    ----------
    sections : dict of str to list of dict
        The sections of the JSON that are used, by name.
    scene : object
        Index of the displayed scene in the JSON.
    buffers : tuple of bytes
        The buffers, each with the length in the JSON.
    """

    sections: dict[str, list[Entry]]
    scene: object
    buffers: tuple[bytes, ...]

    def entry(self, section: str, number: object) -> Entry:
        """Return the entry of a section with the given index; raise MalformedMeshError if there is none."""
        members = self.sections[section]
        if type(number) is not int or not 0 <= number < len(members):
            raise MalformedMeshError(f"the GLB refers to an entry of its {section} that is not there")
        return members[number]


def entries(parent: Entry, name: str) -> list[Entry]:
    """Return a list of objects; an empty list if it is absent."""
    members = parent.get(name, [])
    if not isinstance(members, list) or not all(isinstance(member, dict) for member in members):
        raise MalformedMeshError(f"the {name} in the JSON of the GLB are not a list of objects")
    return members


def whole(entry: Entry, name: str, default: int | None = None) -> int:
    """Return an integer >= 0; without a default the entry must have it."""
    number = entry.get(name, default)
    if type(number) is not int or number < 0:
        raise MalformedMeshError(f"a {name} in the JSON of the GLB is not a whole number from 0 up")
    return number


def read_document(data: bytes) -> Document:
    """Parse a GLB.

    Raise MalformedMeshError if the file is not GLB 2.0, is truncated, or requires an unsupported extension,
    and ExternalReferenceError if a buffer or an image is in another file.
    """
    if data[:4] != b"glTF" or len(data) < _HEADER_BYTES:
        raise MalformedMeshError("the file does not begin as a GLB does")
    if int.from_bytes(data[4:8], "little") != 2:
        raise MalformedMeshError("the GLB is not of version 2")
    length = int.from_bytes(data[8:12], "little")
    if length > len(data):
        raise MalformedMeshError(f"the GLB declares {length} bytes but has {len(data)}: it is cut short")
    text, end = _chunk(data, _HEADER_BYTES, _JSON)
    binary = _chunk(data, end, _BINARY)[0] if len(data) - end >= _CHUNK_HEADER_BYTES else b""
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        raise MalformedMeshError("the JSON of the GLB cannot be read") from None
    if not isinstance(tree, dict):
        raise MalformedMeshError("the JSON of the GLB is not an object")
    _refuse_extensions(tree)
    sections = {name: entries(tree, name) for name in _SECTIONS}
    for entry in [*sections["buffers"], *sections["images"]]:
        uri = entry.get("uri")
        if uri is not None and not str(uri).startswith("data:"):
            raise ExternalReferenceError(
                "the GLB refers to another file or address; export it with all embedded"
            )
    # Only the first buffer may be the binary chunk.
    buffers = (_buffer(entry, b"" if number else binary) for number, entry in enumerate(sections["buffers"]))
    return Document(sections, tree.get("scene", 0), tuple(buffers))


def _chunk(data: bytes, start: int, kind: bytes) -> tuple[bytes, int]:
    """Return the body of the chunk at `start`, and the offset of its end."""
    body = start + _CHUNK_HEADER_BYTES
    end = body + int.from_bytes(data[start : start + 4], "little")
    if data[start + 4 : body] != kind or end > len(data):
        raise MalformedMeshError("a chunk of the GLB is not what it should be, or is cut short")
    return data[body:end], end


def _refuse_extensions(tree: Entry) -> None:
    """Raise if the file requires an unsupported extension."""
    required = tree.get("extensionsRequired", [])
    if not isinstance(required, list):
        raise MalformedMeshError("the extensions that the GLB requires are not a list")
    for name in required:
        if not str(name).startswith(_HARMLESS):
            raise MalformedMeshError(
                f"the GLB needs the extension {shown(str(name))}, which is not read; "
                "export without compression"
            )


def _buffer(entry: Entry, binary: bytes) -> bytes:
    """Return a buffer: the binary chunk, or the content of a data URI."""
    uri = entry.get("uri")
    if uri is not None:
        head, _, body = str(uri).partition(",")
        if not head.endswith(";base64"):
            raise MalformedMeshError("a buffer of the GLB is not in base64")
        try:
            binary = base64.b64decode(body, validate=True)
        except (binascii.Error, ValueError):
            raise MalformedMeshError("a buffer of the GLB is not in base64") from None
    length = whole(entry, "byteLength")
    if length > len(binary):
        raise MalformedMeshError(f"a buffer of the GLB declares {length} bytes but has {len(binary)}")
    return binary[:length]


def read_positions(document: Document, number: object, used: Ints) -> Floats:
    """Return the used rows of an accessor, shape (n, 3), decoded by KHR_mesh_quantization if quantised.

    A normalised integer c of b bits is c / (2^b - 1), or max(c / (2^(b-1) - 1), -1) if it is signed. The rows
    `used`, shape (n,), are within the accessor's count.
    """
    accessor = document.entry("accessors", number)
    if accessor.get("type") != "VEC3" or accessor.get("componentType") not in _POSITION_TYPES:
        raise MalformedMeshError("the positions in the GLB are not vectors of three coordinates")
    stored = _read(document, accessor)[used]
    # 32 bits, the precision of glTF, hold integers of 16 bits exactly.
    positions = stored.astype(np.float32)
    if accessor.get("normalized") is True and stored.dtype.kind in "iu":
        largest = 2 ** (8 * stored.itemsize - (stored.dtype.kind == "i")) - 1
        positions = np.maximum(positions / np.float32(largest), np.float32(-1.0))
    return positions.astype(np.float64)


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
