"""What the checks of every format share: the limits, and what they pass on to be read."""

from dataclasses import dataclass

from core.errors import MalformedMeshError, MeshTooComplexError


@dataclass(frozen=True)
class Limits:
    """The largest mesh that is read.

    Attributes
    ----------
    vertices : int
        Vertices that the file holds, instances counted each. The corners of an STL are not counted: the
        format repeats a vertex for every face around it.
    faces : int
        Triangles, after polygons are cut into triangles, instances counted each.
    parts : int
        Solids of an STL, objects and groups of an OBJ; primitives of a GLB, objects of a 3MF and parts of a
        STEP in every place they are shown. Loose components are not parts.
    """

    vertices: int = 2_000_000
    faces: int = 4_000_000
    parts: int = 4_096


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True)
class Plain:
    """A checked file in the plainest form of its format, and what a reader must find in it.

    Attributes
    ----------
    data : bytes
    format : str
    vertices, faces : int
        Vertices and triangles.
    """

    data: bytes
    format: str
    vertices: int
    faces: int


def declared(count: int, size: int, limit: int, things: str) -> None:
    """Check a number of rows that a file declares before anything is made for them.

    Parameters
    ----------
    count : int
        Of `things`, in the plural.
    size : int
        Bytes of the file. A row takes at least one.
    limit : int
        The largest number that is read.

    Raises
    ------
    MalformedMeshError
        The file cannot hold so many.
    MeshTooComplexError
        It could, but they are more than the limit.
    """
    if count > size:
        raise MalformedMeshError(f"the file declares {count} {things}, more than its {size} bytes can hold")
    within(count, limit, things)


def within(count: int, limit: int, things: str) -> None:
    """Raise MeshTooComplexError if `count` is above `limit`; `things` names them in the plural."""
    if count > limit:
        raise MeshTooComplexError(f"the file has {count} {things}; the limit is {limit}")
