"""A part of an assembly."""

import unicodedata
from dataclasses import dataclass

from core.mesh.mesh import Mesh

NAME_CHARACTERS = 128
"""The most characters of a name; longer names are cut."""
PATH_NAMES = 64
"""The most names of a path; of a longer path the last ones are kept."""


@dataclass(frozen=True, eq=False)
class Part:
    """A distinct part of an assembly.

    Attributes
    ----------
    name : str
        The name of its product or object, at most `NAME_CHARACTERS`; empty if the file gives none.
    path : tuple of str
        The names from the root of the assembly to the first instance of the part, at most `PATH_NAMES`.
    instances : int
        How many times the assembly has the part, at least 1.
    mesh : Mesh
        In the frame of the part.
    """

    name: str
    path: tuple[str, ...]
    instances: int
    mesh: Mesh


def clean_name(name: object) -> str:
    """Return a name of a file in Unicode normal form NFC, on one line; empty if it is not text."""
    if not isinstance(name, str):
        return ""
    shown = "".join(letter if letter.isprintable() else " " for letter in name[: 4 * NAME_CHARACTERS])
    return unicodedata.normalize("NFC", " ".join(shown.split()))[:NAME_CHARACTERS].strip()
