"""Reading and writing by trimesh; no other module of the core imports it.

trimesh is imported on first use: the import takes a quarter of a second, and only the processes that read
uploads need it.
"""

import io

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh


def load_glb(data: bytes) -> tuple[Floats, Ints]:
    """Read a checked GLB; its instances are transformed and joined.

    Nothing is merged, dropped or reordered, and no material is read. Without a path and a resolver trimesh
    cannot open another file.

    Returns
    -------
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
    """
    import trimesh  # noqa: PLC0415

    scene = trimesh.load_scene(
        io.BytesIO(data),
        file_type="glb",
        process=False,
        skip_materials=True,
        maintain_order=True,
    )
    mesh = scene.to_mesh()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def save(mesh: Mesh, format: str) -> bytes:
    """Write a mesh in 32 bits: "stl" (binary), "ply" (binary, little-endian) or "glb"."""
    import trimesh  # noqa: PLC0415

    whole = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces, process=False)
    written = whole.export(file_type=format)
    assert isinstance(written, bytes)
    return written
