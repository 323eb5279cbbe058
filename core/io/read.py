"""Reading a mesh from the bytes of a file."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from core.errors import (
    CoreError,
    DegenerateMeshError,
    EmptyFileError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
)
from core.io import glb, obj, off, ply, step, stl, threemf
from core.io.checks import DEFAULT_LIMITS, Limits
from core.io.formats import known
from core.mesh.face_normals import face_normals
from core.mesh.mesh import Mesh

_READERS = {"stl": stl.read, "obj": obj.read, "ply": ply.read, "off": off.read, "glb": glb.read}
_ARCHIVES = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "ZIP",
    b"BZh": "bzip2",
    b"\xfd7zXZ": "xz",
    b"7z\xbc\xaf": "7z",
}
# Faces whose area is taken at a time: the first block of a sound mesh answers.
_BLOCK = 4096


def read_mesh(data: bytes, format: str, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Read a mesh from the bytes of a file.

    Polygons are triangulated. All objects, groups, solids and instances are joined, with the transforms of
    the file. Vertices are neither merged nor moved. 3MF and STEP files state their unit and are read in
    millimetres.

    Parameters
    ----------
    data : bytes
        The whole file.
    format : str
        One of `READABLE`.
    limits : Limits
        The largest mesh that is read.

    Returns
    -------
    mesh : Mesh

    Raises
    ------
    UnknownFormatError
        The format is not one of `READABLE`, or its reader is not installed.
    EmptyFileError
        The file has no bytes.
    MalformedMeshError
        The file violates its format: it has another format, is truncated, or has an index out of range.
    NonFiniteCoordinatesError
        A coordinate is NaN or infinite.
    NoTrianglesError
        The mesh has no faces.
    DegenerateMeshError
        Every face has zero area.
    MeshTooComplexError
        The mesh has more vertices, faces or parts than the limits.
    ExternalReferenceError
        The file refers to another file.
    """
    name = known(format)
    with reading(data, name):
        mesh = _read(data, name, limits)
    if is_degenerate(mesh):
        raise DegenerateMeshError("every face has zero area")
    return mesh


@contextmanager
def reading(data: bytes, name: str) -> Iterator[None]:
    """Refuse an empty or compressed file of the format `name`, and one over which the reader fails.

    Raises
    ------
    EmptyFileError
        The file has no bytes.
    MalformedMeshError
        The file is compressed, or the reader failed with an error that is not of the core.
    MeshTooComplexError
        The reader ran out of memory.
    """
    if not data:
        raise EmptyFileError("the file is empty")
    for start, archive in _ARCHIVES.items():
        if data.startswith(start) and name != "3mf":
            raise MalformedMeshError(f"the file is compressed ({archive}); send the {name.upper()} itself")
    try:
        # A number that overflows becomes infinite, and is refused as that.
        with np.errstate(all="ignore"):
            yield
    except CoreError:
        raise
    except MemoryError:
        raise MeshTooComplexError(f"the {name.upper()} takes more memory than there is") from None
    except Exception as error:
        raise MalformedMeshError(
            f"the {name.upper()} cannot be read: a value in it is missing, or is not a number"
        ) from error


def _read(data: bytes, name: str, limits: Limits) -> Mesh:
    if name == "3mf":
        return threemf.read(data, limits)
    if name == "step":
        return _read_step(data, limits)
    vertices, faces = _READERS[name](data, limits)
    if len(faces) == 0:
        raise NoTrianglesError(f"the {name.upper()} has no faces")
    return Mesh(vertices, faces)


def _read_step(data: bytes, limits: Limits) -> Mesh:
    """Convert a STEP file to GLB and read that, in millimetres."""
    try:
        mesh = _read(step.to_glb(data, limits), "glb", limits)
    except NoTrianglesError:
        raise NoTrianglesError("nothing in the STEP can be made into triangles") from None
    return Mesh(mesh.vertices * step.MILLIMETRES, mesh.faces)


def is_degenerate(mesh: Mesh) -> bool:
    """Whether no face has a larger area than the rounding of its coordinates causes."""
    largest = float(np.abs(mesh.vertices).max())
    if largest == 0:
        return True
    for start in range(0, len(mesh.faces), _BLOCK):
        # Scaled first, so that no coordinate is too large or too small for its square.
        corners = mesh.vertices[mesh.faces[start : start + _BLOCK]] / largest
        area = np.linalg.norm(face_normals(corners, unit=False), axis=1) / 2
        longest = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).max(axis=1)
        if (area > 2 * np.finfo(np.float64).eps * longest).any():
            return False
    return True
