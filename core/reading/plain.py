"""What the checks of every format share: the limits, and what they pass on to be read."""

from dataclasses import dataclass

from core.errors import MeshTooComplexError


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
        Solids of an STL, objects and groups of an OBJ, primitives of a GLB in every place they are shown. Loose
        components are not parts.
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


def within(count: int, limit: int, things: str) -> None:
    """Raise MeshTooComplexError if `count` is above `limit`; `things` names them in the plural."""
    if count > limit:
        raise MeshTooComplexError(f"the file has {count} {things}; the limit is {limit}")
