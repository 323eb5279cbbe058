"""Answers of the readers of uploads, as safetensors: a mesh, or the parts of an assembly.

A reader is not trusted, so each answer is checked as an upload is.
"""

import json
from dataclasses import dataclass

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.errors import CoreError, MalformedMeshError
from core.io import PATH_NAMES, Limits, clean_name
from core.mesh.mesh import Mesh

_ABOUT = "about"


@dataclass(frozen=True)
class ReadMesh:
    """A mesh, and the wall time of reading it in milliseconds."""

    mesh: Mesh
    milliseconds: float


def largest_size(limits: Limits) -> int:
    """Return the most bytes of `mesh_to_bytes`: three numbers of 64 bits for each vertex and face, and names.

    An STL file has three vertices for each face, which are counted once they are merged.
    """
    return 24 * (max(limits.vertices, 3 * limits.faces) + limits.faces) + 64 * 1024


def mesh_to_bytes(read: ReadMesh) -> bytes:
    """Return the bytes that `mesh_from_bytes` reads."""
    arrays = {
        "vertices": np.ascontiguousarray(read.mesh.vertices, dtype=np.float64),
        "faces": np.ascontiguousarray(read.mesh.faces, dtype=np.int64),
        "milliseconds": np.array([read.milliseconds]),
    }
    return bytes(save(arrays))


def mesh_from_bytes(data: bytes) -> ReadMesh:
    """Return the mesh that an untrusted process has read, checked as any mesh.

    Raises
    ------
    MalformedMeshError
        The bytes are not a mesh.
    """
    try:
        arrays = load(data)
        vertices, faces, milliseconds = (arrays[name] for name in ("vertices", "faces", "milliseconds"))
        if vertices.dtype != np.float64 or faces.dtype != np.int64:
            raise TypeError("arrays of another type")
        return ReadMesh(Mesh(vertices, faces), float(milliseconds.item()))
    except (SafetensorError, CoreError, KeyError, TypeError, ValueError) as error:
        raise MalformedMeshError("a reader returned no mesh") from error


@dataclass(frozen=True)
class PartFile:
    """A distinct part of an assembly, as a 3MF: see `core.io.Part`."""

    name: str
    path: tuple[str, ...]
    instances: int
    data: bytes


def parts_to_bytes(parts: list[PartFile]) -> bytes:
    """Return the bytes that `parts_from_bytes` reads."""
    about = json.dumps([[part.name, part.path, part.instances] for part in parts]).encode()
    arrays = {str(number): part.data for number, part in enumerate(parts)} | {_ABOUT: about}
    return bytes(save({name: np.frombuffer(data, dtype=np.uint8) for name, data in arrays.items()}))


def parts_from_bytes(data: bytes, most: int) -> list[PartFile]:
    """Return at most `most` parts that an untrusted process has read; their files are read as any uploads.

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
