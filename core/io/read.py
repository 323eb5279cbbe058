"""Reading and writing a mesh as the bytes of a file, whatever its format."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.errors import (
    CoreError,
    DegenerateMeshError,
    EmptyFileError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
)
from core.io.checks import DEFAULT_LIMITS, Limits
from core.io.formats import FORMATS, Format, read_format, written_format
from core.io.parts import Part
from core.io.recognition import recognised, recognised_text
from core.io.stl import is_binary
from core.mesh.mesh import Mesh, face_normals

# Faces whose area is computed at a time: the first block of a sound mesh answers.
_BLOCK = 4096


@dataclass(frozen=True)
class MeshFile:
    """A mesh, and warnings of what its reader left out or guessed, each a sentence."""

    mesh: Mesh
    warnings: tuple[str, ...] = ()


def read_mesh(data: bytes, format: str, *, limits: Limits = DEFAULT_LIMITS) -> Mesh:
    """Return the mesh of `read_file`."""
    return read_file(data, format, limits=limits).mesh


def read_file(data: bytes, format: str, *, limits: Limits = DEFAULT_LIMITS) -> MeshFile:
    """Read a mesh from the bytes of a whole file; `format` is an ending of `FORMATS`.

    Polygons are triangulated. All objects, groups, solids and instances are joined, with the transforms of
    the file. Vertices of faces are neither merged nor moved; a vertex of no face may be anywhere, and is put
    on the first face. Files of a format that states a unit are read in millimetres.

    Raise MeshError, whose subclass of `core.errors` tells why the file cannot be read as such a mesh.
    """
    reader = read_format(format)
    with _reading(data, reader):
        vertices, faces, warnings = reader.read(data, limits)
        if len(faces) == 0:
            raise NoTrianglesError(f"the {reader.title} has no faces")
        mesh = Mesh(_with_faces(vertices, faces), faces)
    if is_degenerate(mesh):
        raise DegenerateMeshError("every face has zero area")
    return MeshFile(mesh, warnings)


def read_parts(data: bytes, format: str, *, limits: Limits = DEFAULT_LIMITS) -> list[Part]:
    """Read the distinct parts of an assembly.

    The parts of a STEP are its products with triangles, and those of a 3MF its objects, each in its own
    frame, in millimetres. Parts with the same name and the same mesh are one, in the order of their first
    instances in the file. The list is empty if the file has one instance of one part, or is of a format
    without assemblies. Parameters and errors are those of `read_file`; MeshError is also raised if there are
    more different parts than the limits, or one without area.
    """
    reader = read_format(format)
    with _reading(data, reader):
        parts = reader.read_parts(data, limits) if reader.splits else []
    for part in parts:
        if is_degenerate(part.mesh):
            raise DegenerateMeshError(f"every face of the part {part.name!r} has zero area")
    return parts if sum(part.instances for part in parts) > 1 else []


def write_mesh(mesh: Mesh, format: str) -> bytes:
    """Write a mesh; the same mesh gives the same bytes.

    OBJ, OFF and 3MF keep the exact coordinates, in the fewest digits that restore them; the unit of a 3MF is
    the millimetre. STL and PLY are binary; they and GLB round to 32 bits. In an STL each face has its own
    three vertices.

    Raise UnknownFormatError if the format is not one of `writable()`, NonFiniteCoordinatesError if a
    coordinate is too large for 32 bits, and NoTrianglesError if every face of a 3MF would name a vertex
    twice.
    """
    return written_format(format).write(mesh)


@contextmanager
def _reading(data: bytes, format: Format) -> Iterator[None]:
    """Refuse an empty file, and one that begins as no file of the format does.

    Within the context, a lack of memory becomes MeshTooComplexError, any error that is not of the core
    MalformedMeshError, and a file that looks like text of another format is named so.
    """
    if not data:
        raise EmptyFileError("the file is empty")
    if not data.strip() or not data.strip(b"\0"):
        raise EmptyFileError("the file has nothing but blanks or zeros")
    kind = recognised(data)
    # A glTF may come in a ZIP, which is no kind of its own.
    if format.name == "glb" and data.startswith(FORMATS["3mf"].magic):
        kind = format
    # The header of a binary STL may say anything.
    if format.name == "stl" and is_binary(data):
        kind = format
    if isinstance(kind, str) and not (kind.startswith("a ZIP") and format.name == "3mf"):
        raise MalformedMeshError(f"the file is {kind}; send the {format.title} itself")
    if isinstance(kind, Format) and kind is not format:
        raise _misnamed(kind, format)
    try:
        # A number that overflows becomes infinite, and is refused as that.
        with np.errstate(all="ignore"):
            yield
    except (MalformedMeshError, NoTrianglesError):
        kind = recognised_text(data) or recognised(data)
        if isinstance(kind, Format) and kind is not format:
            raise _misnamed(kind, format) from None
        raise
    except CoreError:
        raise
    except MemoryError:
        raise MeshTooComplexError(f"the {format.title} takes more memory than there is") from None
    except Exception as error:
        raise MalformedMeshError(
            f"the {format.title} cannot be read: a value in it is missing, or is not a number"
        ) from error


def _misnamed(kind: Format, format: Format) -> MalformedMeshError:
    """Return the error of a file whose content has another format than its name says."""
    return MalformedMeshError(
        f"the file is of the format {kind.title}, and its name says {format.title}: "
        f"give it the ending .{kind.endings[0]}"
    )


def _with_faces(vertices: Floats, faces: Ints) -> Floats:
    """Return the vertices, shape (n, 3), with those of no face moved to the first one of the first face."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    return vertices if used.all() else np.where(used[:, None], vertices, vertices[faces[0, 0]])


def is_degenerate(mesh: Mesh) -> bool:
    """Return whether no face has a larger area than the rounding of its coordinates causes."""
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
