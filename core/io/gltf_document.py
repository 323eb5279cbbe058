"""The JSON and the buffers of a glTF 2.0, with checked access to entries and accessors (section 3.6).

They are the two chunks of a GLB, a JSON that holds its buffers, or a ZIP of a JSON and its files.
"""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import ExternalReferenceError, MalformedMeshError
from core.io.checks import Limits, shown
from core.io.package import Package

# A JSON object of the glTF.
Entry = dict[str, Any]

_HEADER_BYTES = 12
_CHUNK_HEADER_BYTES = 8
_SECTIONS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers", "skins")
_JSON, _BINARY = b"JSON", b"BIN\0"
# Extensions that are read, and those that change neither positions nor triangles.
_HARMLESS = (
    *("KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility", "KHR_materials_"),
    *(
        "KHR_texture_",
        "EXT_texture_",
        "MSFT_texture_",
        "MSFT_packing_",
        "KHR_lights_",
        "EXT_lights_",
        "KHR_xmp",
    ),
    *("ADOBE_materials_", "KHR_techniques_webgl", "KHR_animation_pointer", "KHR_audio", "KHR_physics_"),
    *("EXT_structural_metadata", "EXT_mesh_features", "EXT_feature_metadata", "FB_ngon_encoding", "VRM"),
    *("CESIUM_RTC", "AGI_"),
)
_COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
# Component types of accessors, and values of an element.
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_INDEX_TYPES = {5121, 5123, 5125}


@dataclass(frozen=True)
class Document:
    """The content of a GLB: the sections of the JSON that are used, by name, and the buffers.

    `scene` is the index of the displayed scene as the JSON has it. A buffer has the length in the JSON; one
    in another file is the error of using it.
    """

    sections: dict[str, list[Entry]]
    scene: object
    buffers: tuple[bytes | ExternalReferenceError, ...]

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


def read_document(data: bytes, limits: Limits) -> Document:
    """Parse a GLB, a JSON with embedded buffers, or a ZIP with a JSON and its buffers.

    Raise MalformedMeshError if the file is not glTF 2.0, is truncated, or requires an unsupported extension,
    and MeshTooComplexError if a ZIP unpacks to more than `Package` allows. An accessor whose buffer is in
    another file raises ExternalReferenceError when it is read. Pictures are not looked for.
    """
    binary, files, folder = b"", None, ""
    if data[:4] == b"glTF" and len(data) >= _HEADER_BYTES:
        text, binary = _chunks(data)
    elif data[:4] == b"PK\x03\x04":
        files = Package(data, limits, "ZIP")
        name = _only_json(files)
        folder, text = name.rpartition("/")[0], files.read(name)
    elif data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{":
        text = data
    else:
        raise MalformedMeshError("the file does not begin as a GLB or glTF does")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        raise MalformedMeshError("the JSON of the GLB cannot be read") from None
    if not isinstance(tree, dict):
        raise MalformedMeshError("the JSON of the GLB is not an object")
    _refuse_extensions(tree)
    sections = {name: entries(tree, name) for name in _SECTIONS}
    # Only the first buffer may be the binary chunk.
    buffers = tuple(
        _buffer(entry, b"" if number else binary, files, folder)
        for number, entry in enumerate(sections["buffers"])
    )
    return Document(sections, tree.get("scene", 0), buffers)


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the two chunks of a GLB: the JSON, and the first buffer, which may be empty."""
    if int.from_bytes(data[4:8], "little") != 2:
        raise MalformedMeshError("the GLB is not of version 2")
    length = int.from_bytes(data[8:12], "little")
    if length > len(data):
        raise MalformedMeshError(f"the GLB declares {length} bytes but has {len(data)}: it is cut short")
    text, end = _chunk(data, _HEADER_BYTES, _JSON)
    return text, _chunk(data, end, _BINARY)[0] if length - end >= _CHUNK_HEADER_BYTES else b""


def _only_json(files: Package) -> str:
    """Return the name of the one glTF in a ZIP."""
    names = [name for name in files.names() if name.endswith(".gltf") and not name.startswith("__macosx/")]
    if not names:
        raise MalformedMeshError("the ZIP holds no file that ends with .gltf")
    if len(names) > 1:
        raise MalformedMeshError(f"the ZIP holds {len(names)} files that end with .gltf: send one of them")
    return names[0]


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
            if name in _COMPRESSED:
                raise compressed(str(name))
            raise MalformedMeshError(
                f"the GLB needs the extension {shown(str(name))}, which is not read; export without it"
            )


def compressed(extension: str) -> MalformedMeshError:
    """Return the error of a mesh that only an extension for compression holds."""
    method = _COMPRESSED[extension]
    return MalformedMeshError(
        f"the GLB is compressed by {method}, which is not read; export without compression"
    )


def _buffer(
    entry: Entry, binary: bytes, files: Package | None, folder: str
) -> bytes | ExternalReferenceError:
    """Return a buffer: the binary chunk, the content of a data URI, or a file beside the JSON in a ZIP."""
    uri = entry.get("uri")
    if uri is not None and not str(uri).startswith("data:"):
        path = "/".join(filter(None, [folder, unquote(str(uri)).removeprefix("./")])).lower()
        if files is None or path not in files.names():
            return ExternalReferenceError(
                f"the glTF refers to another file, {shown(str(uri).replace('.', '_'))}: "
                "export it as a GLB, or send both in one ZIP"
            )
        binary = files.read(path)
    elif uri is not None:
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


def read_vectors(document: Document, number: object, kind: str, rows: Ints | None = None) -> Floats:
    """Return the rows of an accessor of vectors or matrices in 64 bits, shape (n, width).

    `kind` is "VEC3", "VEC4" or "MAT4"; `rows`, shape (n,), are within its count, None for all. A normalised
    integer c of b bits is c / (2^b - 1), or max(c / (2^(b-1) - 1), -1) if it is signed.
    """
    accessor = document.entry("accessors", number)
    if accessor.get("type") != kind or accessor.get("componentType") == 5125:
        raise MalformedMeshError(f"an accessor of the GLB has not the type that it should have, {kind}")
    stored = _read(document, accessor, rows)
    # 32 bits, the precision of glTF, hold integers of 16 bits exactly.
    values = stored.astype(np.float32)
    if accessor.get("normalized") is True and stored.dtype.kind in "iu":
        largest = 2 ** (8 * stored.itemsize - (stored.dtype.kind == "i")) - 1
        values = np.maximum(values / np.float32(largest), np.float32(-1.0))
    return values.astype(np.float64)


def read_integers(document: Document, number: object, kind: str = "SCALAR", rows: Ints | None = None) -> Ints:
    """Return the rows of an accessor of integers >= 0, shape (n, width); parameters as in `read_vectors`."""
    accessor = document.entry("accessors", number)
    if accessor.get("type") != kind or accessor.get("componentType") not in _INDEX_TYPES:
        raise MalformedMeshError("the indices in the GLB are not whole numbers")
    return _read(document, accessor, rows).astype(np.int64)


def count_elements(document: Document, number: object) -> int:
    """Return the number of elements of an accessor, after a check that its buffer holds them."""
    accessor = document.entry("accessors", number)
    return whole(accessor, "count") if "sparse" in accessor else len(_stored(document, accessor))


def _read(document: Document, accessor: Entry, rows: Ints | None) -> NDArray[np.generic]:
    """Return rows of an accessor, with the values of its sparse part, shape (n, width)."""
    if "sparse" not in accessor:
        stored = _stored(document, accessor)
        return stored if rows is None else stored[rows]
    count, sparse = whole(accessor, "count"), accessor["sparse"]
    wanted = np.arange(count) if rows is None else rows
    if "bufferView" in accessor:
        values = _stored(document, accessor)[wanted]
    else:
        # Zeros, but for the sparse part.
        kind = np.dtype(_TYPES[accessor["componentType"]])
        values = np.zeros((len(wanted), _WIDTHS[accessor["type"]]), kind)
    try:
        changed = whole(sparse, "count")
        indices = (
            _stored(document, {**sparse["indices"], "type": "SCALAR", "count": changed}).ravel().astype(int)
        )
        changes = _stored(document, {**accessor, "byteOffset": 0, **sparse["values"], "count": changed})
    except (AttributeError, KeyError, TypeError):
        raise MalformedMeshError("a sparse accessor of the GLB is not complete") from None
    if changed and (indices[0] < 0 or indices[-1] >= count or (np.diff(indices) <= 0).any()):
        raise MalformedMeshError("the indices of a sparse accessor of the GLB do not rise within its count")
    if changed:
        nearest = np.minimum(np.searchsorted(indices, wanted), changed - 1)
        hit = indices[nearest] == wanted
        values[hit] = changes[nearest[hit]]
    return values


def _stored(document: Document, accessor: Entry) -> NDArray[np.generic]:
    """Return the rows of an accessor without a copy, shape (count, width), without its sparse part."""
    if accessor.get("type") not in _WIDTHS or accessor.get("componentType") not in _TYPES:
        raise MalformedMeshError("an accessor of the GLB has a type that is not read")
    if "bufferView" not in accessor:
        # Such an accessor means `count` zeros: a few bytes of file could allocate any amount of memory.
        raise MalformedMeshError("an accessor of the GLB has no data")
    view = document.entry("bufferViews", accessor["bufferView"])
    number = whole(view, "buffer")
    if number >= len(document.buffers):
        raise MalformedMeshError("the GLB refers to an entry of its buffers that is not there")
    buffer = document.buffers[number]
    if isinstance(buffer, ExternalReferenceError):
        raise buffer
    start, length = whole(view, "byteOffset", 0), whole(view, "byteLength")
    kind = np.dtype(_TYPES[accessor["componentType"]])
    width = _WIDTHS[accessor["type"]]
    count, offset, row = whole(accessor, "count"), whole(accessor, "byteOffset", 0), kind.itemsize * width
    stride = whole(view, "byteStride", row)
    if stride < row or start + length > len(buffer):
        raise MalformedMeshError("a view of the GLB does not fit its buffer")
    if count and offset + stride * (count - 1) + row > length:
        raise MalformedMeshError(
            f"an accessor of the GLB declares {count} elements, more than its data holds"
        )
    return np.ndarray(
        (count, width), dtype=kind, buffer=buffer, offset=start + offset, strides=(stride, kind.itemsize)
    )
