"""Writing by trimesh; no other module of the core imports it.

trimesh is imported on first use: the import takes a quarter of a second, and readers do not need it.
"""

import numpy as np

from core.errors import NonFiniteCoordinatesError
from core.mesh.mesh import Mesh


def export(mesh: Mesh, format: str) -> bytes:
    """Return a mesh in 32 bits as "stl" (binary), "ply" (binary, little-endian) or "glb".

    Raise NonFiniteCoordinatesError if a coordinate is too large for 32 bits.
    """
    if np.abs(mesh.vertices).max() > np.finfo(np.float32).max:
        raise NonFiniteCoordinatesError(f"a coordinate is too large for the 32 bits of {format.upper()}")
    import trimesh  # noqa: PLC0415

    data = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces, process=False).export(file_type=format)
    assert isinstance(data, bytes)
    return data
