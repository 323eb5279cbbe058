"""The parts of an assembly that a reader has read, as safetensors."""

import json
from dataclasses import dataclass

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.errors import MalformedMeshError
from core.io import PATH_NAMES, clean_name

_ABOUT = "about"


@dataclass(frozen=True)
class PartFile:
    """A distinct part of an assembly, as a 3MF: see `core.io.Part`."""

    name: str
    path: tuple[str, ...]
    instances: int
    data: bytes


def to_bytes(parts: list[PartFile]) -> bytes:
    """The bytes of `from_bytes`."""
    about = json.dumps([[part.name, part.path, part.instances] for part in parts]).encode()
    arrays = {str(number): part.data for number, part in enumerate(parts)} | {_ABOUT: about}
    return bytes(save({name: np.frombuffer(data, dtype=np.uint8) for name, data in arrays.items()}))


def from_bytes(data: bytes, most: int) -> list[PartFile]:
    """At most `most` parts from an untrusted process, whose files are read as any uploads.

    Raises
    ------
    MalformedMeshError
        The bytes are not parts.
    """
    try:
        arrays = {name: array.tobytes() for name, array in load(data).items()}
        parts = [
            PartFile(name, tuple(path), instances, arrays[str(number)])
            for number, (name, path, instances) in enumerate(json.loads(arrays[_ABOUT]))
        ]
        if len(parts) > most or not all(map(_is_sound, parts)):
            raise ValueError("no parts of an assembly")
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise MalformedMeshError("a reader returned no parts") from error
    return parts


def _is_sound(part: PartFile) -> bool:
    return (
        all(type(text) is str and text == clean_name(text) for text in (part.name, *part.path))
        and len(part.path) <= PATH_NAMES
        and type(part.instances) is int
        and part.instances >= 1
    )
