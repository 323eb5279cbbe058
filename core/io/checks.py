"""Limits of a mesh file, and checks of counts against them."""

from dataclasses import dataclass

from core.errors import MalformedMeshError, MeshTooComplexError


@dataclass(frozen=True)
class Limits:
    """The largest mesh that is read.

    Attributes
    ----------
    vertices : int
        Vertices of the file, counted for each instance. The corners of an STL do not count: the format
        repeats a vertex for every face at it.
    faces : int
        Triangles after polygons are triangulated, counted for each instance.
    parts : int
        Solids of an STL, objects and groups of an OBJ; instances of primitives of a GLB, of objects of a 3MF
        and of parts of a STEP. Connected components are not parts.
    distinct_parts : int
        Different parts of an assembly that is split.
    """

    vertices: int = 2_000_000
    faces: int = 4_000_000
    parts: int = 4_096
    distinct_parts: int = 256


DEFAULT_LIMITS = Limits()


def declared(count: int, size: int, limit: int, things: str) -> None:
    """Check a declared number of rows before memory is allocated for them.

    Parameters
    ----------
    count : int
        Declared number of rows.
    size : int
        Bytes of the file. A row takes at least one.
    limit : int
        Largest number that is read.
    things : str
        Name of the rows in the plural.

    Raises
    ------
    MalformedMeshError
        The file is too small for the declared number.
    MeshTooComplexError
        The number exceeds the limit.
    """
    if count > size:
        raise MalformedMeshError(f"the file declares {count} {things}, more than its {size} bytes can hold")
    within(count, limit, things)


def within(count: int, limit: int, things: str) -> None:
    """Raise MeshTooComplexError if `count` is above `limit`; `things` names them in the plural."""
    if count > limit:
        raise MeshTooComplexError(f"the file has {count} {things}; the limit is {limit}")
