"""A mesh to bytes."""

import numpy as np

from core.errors import NonFiniteCoordinatesError
from core.mesh import Mesh
from core.reading.loading import save
from core.reading.names import written
from core.reading.text import face_lines


def write_mesh(mesh: Mesh, format: str) -> bytes:
    """Write a mesh; the same mesh gives the same bytes.

    OBJ and OFF hold the very coordinates, in the fewest digits that give them back. STL and PLY are written
    in binary; they and GLB round to 32 bits. STL shares no vertices: each face has its own three.

    Parameters
    ----------
    mesh : Mesh
        What to write.
    format : str
        One of `FORMATS`.

    Returns
    -------
    data : bytes

    Raises
    ------
    UnknownFormatError
        The format is not one of `FORMATS`.
    NonFiniteCoordinatesError
        A coordinate is too large for the 32 bits of the format.
    """
    name = written(format)
    if name == "obj":
        return _vertex_lines(mesh, "v %r %r %r\n") + face_lines(mesh.faces + 1, "f %d %d %d\n")
    if name == "off":
        counts = b"OFF\n%d %d 0\n" % (len(mesh.vertices), len(mesh.faces))
        return counts + _vertex_lines(mesh, "%r %r %r\n") + face_lines(mesh.faces, "3 %d %d %d\n")
    if np.abs(mesh.vertices).max() > np.finfo(np.float32).max:
        raise NonFiniteCoordinatesError(f"a coordinate is too large for the 32 bits of {name.upper()}")
    return save(mesh, name)


def _vertex_lines(mesh: Mesh, form: str) -> bytes:
    """Write one line a vertex; trimesh's fixed number of decimals would not do for small units."""
    return (form * len(mesh.vertices) % tuple(mesh.vertices.ravel().tolist())).encode()
