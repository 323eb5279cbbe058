"""The distinct parts of an assembly, and the names that a file gives them."""

import hashlib
import unicodedata
from collections import Counter
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from core.arrays import Floats, Ints
from core.io.checks import Limits, within
from core.mesh.mesh import Mesh

NAME_CHARACTERS = 128
"""The most characters of a name; longer names are cut."""
PATH_NAMES = 64
"""The most names of a path; of a longer path the last ones are kept."""

_Instance = TypeVar("_Instance")


@dataclass(frozen=True, eq=False)
class Part:
    """A distinct part of an assembly, with its mesh in its own frame.

    `name` is that of its product or object, at most `NAME_CHARACTERS`, empty if the file gives none. `path`
    has the names from the root to its first instance, at most `PATH_NAMES`.
    """

    name: str
    path: tuple[str, ...]
    instances: int
    mesh: Mesh


def distinct(instances: Iterable[tuple[Hashable, _Instance]], limits: Limits) -> list[tuple[_Instance, int]]:
    """Return the first instance of each key and the number of its instances, in the order of the first ones.

    Instances with the same key are the same part. Raise MeshTooComplexError if there are more different parts
    than the limit.
    """
    first: dict[Hashable, _Instance] = {}
    counts: Counter[Hashable] = Counter()
    for key, instance in instances:
        if key not in first:
            within(len(first) + 1, limits.distinct_parts, "different parts")
            first[key] = instance
        counts[key] += 1
    return [(instance, counts[key]) for key, instance in first.items()]


def mesh_digest(vertices: Floats, faces: Ints) -> bytes:
    """Return a hash of a mesh."""
    digest = hashlib.sha256(vertices.tobytes())
    digest.update(faces.tobytes())
    return digest.digest()


def clean_name(name: object) -> str:
    """Return a name of a file in Unicode normal form NFC, on one line; empty if it is not text."""
    if not isinstance(name, str):
        return ""
    shown = "".join(letter if letter.isprintable() else " " for letter in name[: 4 * NAME_CHARACTERS])
    return unicodedata.normalize("NFC", " ".join(shown.split()))[:NAME_CHARACTERS].strip()
