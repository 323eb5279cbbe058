"""Times of an embedding's stages, measured without changes to the pipeline."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from types import ModuleType
from typing import Any

from core import pipeline
from core.embedding import Embedding
from core.io import read_mesh
from core.mesh import simplification
from core.pipeline import Pipeline
from core.spectral import spectral_embedding as spectra

READING, REST = "read", "rest"

STAGES: dict[str, tuple[ModuleType, str]] = {
    "clean": (pipeline, "clean"),
    "close holes": (pipeline, "fill_holes"),
    "normal frame": (pipeline, "normal_frame"),
    "simplify": (pipeline, "simplify"),
    "refine": (pipeline, "refine"),
    "edge graph": (pipeline, "edge_graph"),
    "Lewis weights": (pipeline, "lewis_weights"),
    "farthest-point sampling": (pipeline, "weighted_farthest_points"),
    "sparse graph, MST": (pipeline, "sparse_graph"),
    "geodesics": (pipeline, "geodesics"),
    "affinity": (spectra, "_affinity_pairs"),
    "Laplace-Beltrami": (spectra, "laplace_beltrami"),
    "global descriptors": (pipeline, "global_descriptors"),
    "facts": (pipeline, "measure"),
    "spin images": (pipeline, "describe"),
}
"""The function of each stage, and the module that calls it."""

_CALLS = (*STAGES.items(), ("clean", (simplification, "clean")))
"""All calls of the stages' functions: simplification cleans its result."""

SAMPLING = tuple(list(STAGES)[: list(STAGES).index("farthest-point sampling") + 1])
"""Stages before the samples are known."""

EMBEDDING = tuple(stage for stage in (*STAGES, REST) if stage not in SAMPLING)
"""Stages after the samples are known."""


@contextmanager
def watched() -> Iterator[dict[str, float]]:
    """Seconds by stage of embeddings in the block; time in a nested stage counts only for that stage."""
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
        for name, (module, function) in _CALLS:
            setattr(module, function, timed(name, plain[name]))
        yield seconds
    finally:
        for name, (module, function) in _CALLS:
            setattr(module, function, plain[name])


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
