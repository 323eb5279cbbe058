"""The time of each stage of an embedding, measured without a line of code in the pipeline."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from types import ModuleType
from typing import Any

from core import sparse_embedding as embedding_steps
from core.embedding import Embedding
from core.graph import sparse_graph as graph_steps
from core.io import read_mesh
from core.mesh import preparation, simplification
from core.pipeline import Pipeline
from core.sampling import sampling
from core.spectral import spectral_embedding as spectra

READING, REST = "read", "rest"

STAGES: dict[str, tuple[tuple[ModuleType, str], ...]] = {
    "clean": ((preparation, "clean"), (simplification, "clean")),
    "close holes": ((preparation, "fill_holes"),),
    "normal frame": ((preparation, "normal_frame"),),
    "simplify": ((preparation, "simplify"),),
    "refine": ((preparation, "refine"),),
    "edge graph": ((embedding_steps, "component_bridges"), (embedding_steps, "edge_graph")),
    "Lewis weights": ((sampling, "lewis_weights"),),
    "samples": ((sampling, "weighted_farthest_points"),),
    "sparse graph, MST": ((embedding_steps, "sparse_graph"),),
    "geodesics": ((graph_steps, "geodesics"),),
    "affinity": ((spectra, "_affinity_pairs"),),
    "Laplace-Beltrami": ((spectra, "laplace_beltrami"),),
    "global descriptors": ((embedding_steps, "global_descriptors"),),
    "mesh facts": ((embedding_steps, "measure"),),
    "spin images": ((embedding_steps, "describe"),),
}
"""The function of each stage, and each module that calls it."""

SAMPLING = tuple(list(STAGES)[: list(STAGES).index("samples") + 1])
"""The stages up to the samples."""

EMBEDDING = tuple(stage for stage in (*STAGES, REST) if stage not in SAMPLING)
"""The stages after the samples."""


@contextmanager
def watched() -> Iterator[dict[str, float]]:
    """Measure the stages of embeddings within the block, in seconds.

    The time of a stage that runs inside another counts for the inner stage alone.
    """
    seconds = dict.fromkeys(STAGES, 0.0)
    inside: list[float] = []

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:  # noqa: ANN401  whatever the stage takes and gives
            inside.append(0.0)
            start = perf_counter()
            try:
                return function(*args, **options)
            finally:
                spent = perf_counter() - start
                seconds[name] += spent - inside.pop()
                if inside:
                    inside[-1] += spent

        return call

    plain = [
        (module, function, name, getattr(module, function))
        for name, places in STAGES.items()
        for module, function in places
    ]
    try:
        for module, function, name, original in plain:
            setattr(module, function, timed(name, original))
        yield seconds
    finally:
        for module, function, _, original in plain:
            setattr(module, function, original)


def embed_bytes(method: Pipeline, data: bytes, format: str) -> tuple[Embedding, dict[str, float]]:
    """The embedding of a file, and seconds by stage from reading on, whose sum is the total."""
    start = perf_counter()
    mesh = read_mesh(data, format)
    read = perf_counter()
    with watched() as seconds:
        embedding = method.embed(mesh)
    end = perf_counter()
    found = {READING: read - start, **seconds}
    found[REST] = end - start - sum(found.values())
    return embedding, found
