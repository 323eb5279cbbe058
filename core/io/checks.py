"""The content of a mesh file and its limits; checks of counts and of indices; meshes joined."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.arrays import Floats, Ints
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
        Instances of primitives of a GLB, of objects of a 3MF and of parts of a STEP. Solids of an STL, groups
        of an OBJ and connected components are not parts.
    distinct_parts : int
        Different parts of an assembly that is split.
    """

    vertices: int = 2_000_000
    faces: int = 4_000_000
    parts: int = 4_096
    distinct_parts: int = 256


DEFAULT_LIMITS = Limits()


class Content(NamedTuple):
    """The mesh of a file: vertices, shape (n, 3), faces, shape (f, 3), and what a reader left out or guessed.

    `warnings` are sentences for people.
    """

    vertices: Floats
    faces: Ints
    warnings: tuple[str, ...] = ()


def declared(count: int, size: int, limit: int, things: str) -> None:
    """Check a declared number of rows, of at least one byte each, before memory is allocated for them.

    Raise MalformedMeshError if a file of so many bytes cannot hold them; otherwise as `within`.
    """
    if count > size:
        raise MalformedMeshError(f"the file declares {count} {things}, more than its {size} bytes can hold")
    within(count, limit, things)


def within(count: int, limit: int, things: str) -> None:
    """Raise MeshTooComplexError if `count` is above `limit`; `things` names them in the plural."""
    if count > limit:
        raise MeshTooComplexError(f"the file has {count} {things}; the limit is {limit}")


def check_indices(corners: Ints, vertices: int) -> None:
    """Raise MalformedMeshError if an index is outside 0 .. vertices - 1."""
    if corners.size and (corners.min() < 0 or corners.max() >= vertices):
        wrong = int(corners.min() if corners.min() < 0 else corners.max())
        raise MalformedMeshError(
            f"a face refers to vertex {wrong}, counted from 0, but there are {vertices} vertices"
        )


def shown(name: str) -> str:
    """Return a name of a file as messages show it: at most 64 letters, digits and underscores."""
    return "".join(letter for letter in name[:64] if letter.isalnum() or letter == "_")


def joined(meshes: Iterable[tuple[Floats, Ints]]) -> tuple[Floats, Ints]:
    """Return one or more meshes as one: vertices, shape (n, 3), and faces, shape (f, 3)."""
    vertices, faces = zip(*meshes, strict=True)
    starts = np.cumsum([0, *map(len, vertices)])
    shifted = [corners + start for corners, start in zip(faces, starts, strict=False)]
    return np.concatenate(vertices), np.concatenate(shifted)
