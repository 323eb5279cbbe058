"""The two chunks of a GLB, with checked access to the entries of the JSON."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any

from core.errors import ExternalReferenceError, MalformedMeshError

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
        """Return the entry of a section with the given index.

        Raises
        ------
        MalformedMeshError
            The section has no such entry.
        """
        found = self.sections[section]
        if type(number) is not int or not 0 <= number < len(found):
            raise MalformedMeshError(f"the GLB refers to an entry of its {section} that is not there")
        return found[number]


def entries(parent: Entry, name: str) -> list[Entry]:
    """Return a list of objects; an empty list if it is absent."""
    found = parent.get(name, [])
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise MalformedMeshError(f"the {name} in the JSON of the GLB are not a list of objects")
    return found


def whole(entry: Entry, name: str, default: int | None = None) -> int:
    """Return an integer >= 0; without a default the entry must have it."""
    found = entry.get(name, default)
    if type(found) is not int or found < 0:
        raise MalformedMeshError(f"a {name} in the JSON of the GLB is not a whole number from 0 up")
    return found


def read_document(data: bytes) -> Document:
    """Parse a GLB.

    Raises
    ------
    MalformedMeshError
        The file is not GLB 2.0, is truncated, or requires an unsupported extension.
    ExternalReferenceError
        A buffer or an image is in another file.
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
            shown = "".join(letter for letter in str(name)[:64] if letter.isalnum() or letter == "_")
            raise MalformedMeshError(
                f"the GLB needs the extension {shown}, which is not read; export without compression"
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
