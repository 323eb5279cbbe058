"""Where the time of an embedding goes, without a line of it in the pipeline."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from types import ModuleType
from typing import Any

from core import pipeline
from core.embedding import Embedding
from core.io import read_mesh
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
    "covering": (pipeline, "weighted_farthest_points"),
    "sparse graph, MST": (pipeline, "sparse_graph"),
    "geodesics": (pipeline, "geodesics"),
    "affinity": (spectra, "_affinity_pairs"),
    "Laplace-Beltrami": (spectra, "laplace_beltrami"),
    "form": (pipeline, "global_descriptors"),
    "facts": (pipeline, "measure"),
    "patches": (pipeline, "describe"),
}
"""The function that each stage is, by the module that calls it."""

SAMPLING = tuple(list(STAGES)[: list(STAGES).index("covering") + 1])
"""What comes before the samples are known."""

EMBEDDING = tuple(stage for stage in (*STAGES, REST) if stage not in SAMPLING)
"""What follows."""


@contextmanager
def watched() -> Iterator[dict[str, float]]:
    """Seconds by stage of what is embedded inside; what a stage spends in another is the other's."""
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

    plain = {name: getattr(module, function) for name, (module, function) in STAGES.items()}
    try:
        for name, (module, function) in STAGES.items():
            setattr(module, function, timed(name, plain[name]))
        yield seconds
    finally:
        for name, (module, function) in STAGES.items():
            setattr(module, function, plain[name])


def embed_bytes(method: Pipeline, data: bytes, format: str) -> tuple[Embedding, dict[str, float]]:
    """A file's embedding, and the seconds of every stage from reading on; they add up to the whole."""
    start = perf_counter()
    mesh = read_mesh(data, format)
    read = perf_counter()
    with watched() as seconds:
        embedding = method.embed(mesh)
    end = perf_counter()
    found = {READING: read - start, **seconds}
    found[REST] = end - start - sum(found.values())
    return embedding, found
