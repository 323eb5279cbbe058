"""The triangle mesh, validated on construction; normals of triangles."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NonFiniteCoordinatesError, NoTrianglesError

if TYPE_CHECKING:
    from core.mesh.edges import HalfEdges


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh: a frozen, validated pair of read-only arrays.

    `vertices`, float64 of shape (n, 3), are positions in the file's own units; `faces`, int64 of shape
    (f, 3), are rows of three indices into them. Raise MalformedMeshError if an array has the wrong shape, or
    an index is not an integer in 0 .. n - 1, NonFiniteCoordinatesError if a coordinate is NaN or infinite,
    and NoTrianglesError if there are no faces.
    """

    vertices: Floats
    faces: Ints

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64, order="C")
        given = np.asarray(self.faces)
        if given.dtype.kind == "f" and not ((given == np.trunc(given)) & (abs(given) < 2.0**53)).all():
            raise MalformedMeshError("a face refers to a vertex by a number that is not whole")
        faces = np.array(given, dtype=np.int64, order="C")
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise MalformedMeshError(f"vertices must have shape (n, 3), not {vertices.shape}")
        if faces.size == 0:
            raise NoTrianglesError("the mesh has no triangles")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise MalformedMeshError(f"faces must have shape (f, 3), not {faces.shape}")
        if not np.isfinite(vertices).all():
            raise NonFiniteCoordinatesError("a vertex coordinate is NaN or infinite")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise MalformedMeshError(
                f"a face refers to vertex {int(faces.max() if faces.min() >= 0 else faces.min())}, "
                f"but there are {len(vertices)} vertices"
            )
        vertices.flags.writeable = False
        faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @cached_property
    def half_edges(self) -> "HalfEdges":
        """The half-edges of the faces, sorted by edge."""
        from core.mesh.edges import half_edges  # noqa: PLC0415  readers of files need no compiler

        return half_edges(self.faces)


def face_normals(corners: Floats, *, unit: bool = True) -> Floats:
    """Return the normals of triangles, shape (f, 3), by the right-hand rule, from corners, shape (f, 3, 3).

    They have length 1, or 0 for triangles without area; otherwise they are as long as twice the area.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if unit:
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(normals)
