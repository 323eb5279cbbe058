"""Writing a mesh to the bytes of a file."""

import numpy as np

from core.errors import NonFiniteCoordinatesError
from core.io import threemf_write
from core.io.formats import written
from core.io.text import face_lines, vertex_lines
from core.io.trimesh_adapter import save
from core.mesh.mesh import Mesh


def write_mesh(mesh: Mesh, format: str) -> bytes:
    """Write a mesh; the same mesh gives the same bytes.

    OBJ, OFF and 3MF keep the exact coordinates, in the fewest digits that restore them; the unit of a 3MF is
    the millimetre. STL and PLY are binary; they and GLB round to 32 bits. In an STL each face has its own
    three vertices.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    format : str
        One of `WRITABLE`.

    Returns
    -------
    data : bytes

    Raises
    ------
    UnknownFormatError
        The format is not one of `WRITABLE`.
    NonFiniteCoordinatesError
        A coordinate is too large for the 32 bits of the format.
    NoTrianglesError
        The format is 3MF and every face names a vertex twice.
    """
    name = written(format)
    if name == "obj":
        return vertex_lines(mesh.vertices, "v %r %r %r\n") + face_lines(mesh.faces + 1, "f %d %d %d\n")
    if name == "off":
        counts = b"OFF\n%d %d 0\n" % (len(mesh.vertices), len(mesh.faces))
        return counts + vertex_lines(mesh.vertices, "%r %r %r\n") + face_lines(mesh.faces, "3 %d %d %d\n")
    if name == "3mf":
        return threemf_write.write(mesh)
    if np.abs(mesh.vertices).max() > np.finfo(np.float32).max:
        raise NonFiniteCoordinatesError(f"a coordinate is too large for the 32 bits of {name.upper()}")
    return save(mesh, name)
