"""A mesh that a reader has read, as safetensors."""

from dataclasses import dataclass

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.errors import CoreError, MalformedMeshError
from core.mesh.mesh import Mesh


@dataclass(frozen=True)
class Readable:
    """A mesh, and the wall time of reading it in milliseconds."""

    mesh: Mesh
    milliseconds: float


def to_bytes(readable: Readable) -> bytes:
    """The bytes of `from_bytes`."""
    arrays = {
        "vertices": np.ascontiguousarray(readable.mesh.vertices, dtype=np.float64),
        "faces": np.ascontiguousarray(readable.mesh.faces, dtype=np.int64),
        "milliseconds": np.array([readable.milliseconds]),
    }
    return bytes(save(arrays))


def from_bytes(data: bytes) -> Readable:
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
        return Readable(Mesh(vertices, faces), float(milliseconds.item()))
    except (SafetensorError, CoreError, KeyError, TypeError, ValueError) as error:
        raise MalformedMeshError("a reader returned no mesh") from error
