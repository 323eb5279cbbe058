"""The library: meshes in, embeddings and matches out; pure functions of arrays.

    from core import Pipeline, read_mesh

    pipeline = Pipeline()
    first, second = (pipeline.embed(read_mesh(data, "off")) for data in files)
    print(pipeline.match(first, second).cc)

The names below are imported on first use (PEP 562): a program that uses none of them loads no compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.embedding import DenseCorrespondence, Embedding, Match
    from core.io import read_mesh
    from core.mesh.mesh import Mesh
    from core.parameters import DEFAULT, PAPER, Parameters
    from core.pipeline import Pipeline

__all__ = [
    "DEFAULT",
    "PAPER",
    "DenseCorrespondence",
    "Embedding",
    "Match",
    "Mesh",
    "Parameters",
    "Pipeline",
    "read_mesh",
]

_MODULES = {
    **dict.fromkeys(("DEFAULT", "PAPER", "Parameters"), "core.parameters"),
    **dict.fromkeys(("DenseCorrespondence", "Embedding", "Match"), "core.embedding"),
    "Mesh": "core.mesh.mesh",
    "Pipeline": "core.pipeline",
    "read_mesh": "core.io",
}


def __getattr__(name: str) -> object:
    """Import a name of the library on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the library's names."""
    return sorted({*globals(), *__all__})
