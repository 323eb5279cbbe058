"""A mesh that a reader has read, as safetensors."""

from dataclasses import dataclass

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.errors import CoreError, MalformedMeshError
from core.io import Limits
from core.mesh.mesh import Mesh


@dataclass(frozen=True)
class ReadMesh:
    """A mesh, and the wall time of reading it in milliseconds."""

    mesh: Mesh
    milliseconds: float


def largest_size(limits: Limits) -> int:
    """The most bytes of `to_bytes`: three numbers of 64 bits for each vertex and face, and names.

    An STL file has three vertices for each face, which are counted once they are merged.
    """
    return 24 * (max(limits.vertices, 3 * limits.faces) + limits.faces) + 64 * 1024


def to_bytes(read: ReadMesh) -> bytes:
    """The bytes of `from_bytes`."""
    arrays = {
        "vertices": np.ascontiguousarray(read.mesh.vertices, dtype=np.float64),
        "faces": np.ascontiguousarray(read.mesh.faces, dtype=np.int64),
        "milliseconds": np.array([read.milliseconds]),
    }
    return bytes(save(arrays))


def from_bytes(data: bytes) -> ReadMesh:
    """A mesh from an untrusted process, checked as any mesh.

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
