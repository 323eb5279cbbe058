"""The library: meshes in, embeddings and matches out. Pure functions of arrays.

    from core import Pipeline, read_mesh

    pipeline = Pipeline()
    first, second = (pipeline.embed(read_mesh(data, "off")) for data in files)
    print(pipeline.match(first, second).cc)

The names below are imported when they are first used, so that a program that needs none of them loads no
compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.embedding import Embedding, Match
    from core.io import read_mesh
    from core.mesh.mesh import Mesh
    from core.parameters import DEFAULT, PAPER, Parameters
    from core.pipeline import Pipeline

__all__ = ["DEFAULT", "PAPER", "Embedding", "Match", "Mesh", "Parameters", "Pipeline", "read_mesh"]

_MODULES = {
    "DEFAULT": "core.parameters",
    "PAPER": "core.parameters",
    "Embedding": "core.embedding",
    "Match": "core.embedding",
    "Mesh": "core.mesh.mesh",
    "Parameters": "core.parameters",
    "Pipeline": "core.pipeline",
    "read_mesh": "core.io",
}


def __getattr__(name: str) -> object:
    """Import a name of the library when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(_MODULES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """The library's names."""
    return sorted({*globals(), *__all__})
