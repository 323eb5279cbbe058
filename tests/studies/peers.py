"""Times of our embedding and match beside LaPy's ShapeDNA and functional maps by pyfmaps.

    python -m tests.studies.peers DIR [--collection COLLECTION] [--repeats 9]

Runs of the two alternate, in one thread; ratios are of neighbouring runs. An embedding is from the bytes of a
binary PLY, ShapeDNA with 50 eigenvalues from a mesh already read. One of our matches is one of 64 in a call,
both ways; pyfmaps fits a map to wave kernel signatures and refines it by ZoomOut, one way, from its spectra.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from lapy import TriaMesh
from lapy.shapedna import compute_shapedna
from threadpoolctl import threadpool_limits

from core.io import write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.evaluation.benchmark_method import Spread, all_meshes, embedding_seconds, match_steps, neighbours
from service.evaluation.benchmark_shapes import Source, nearest, read_source
from service.evaluation.template_truth import functional_map, spectrum
from tests.studies.common import run, write


def embeddings(source: Source, vertices: int, repeats: int) -> list[dict[str, Any]]:
    """Return times and ratios of embedding meshes of about a number of vertices."""
    method = Pipeline(DEFAULT)
    rows = []
    for name, mesh in nearest(all_meshes(source), vertices, 5):
        data, surface = write_mesh(mesh, "ply"), TriaMesh(mesh.vertices, mesh.faces)
        ours, theirs = (
            partial(embedding_seconds, method, data, "ply"),
            partial(compute_shapedna, surface, k=50),
        )
        rows.append({"mesh": name, "vertices": len(mesh.vertices)} | figures(ours, theirs, "lapy", repeats))
    return rows


def matches(source: Source, vertices: int, repeats: int) -> list[dict[str, Any]]:
    """Return times and ratios of matching pairs of one class and of two."""
    method = Pipeline(DEFAULT)
    rows = []
    for (first, mesh), (second, other) in pairwise(neighbours(source, vertices, 4)):
        one_of_many = match_steps(method.embed(mesh), method.embed(other), method)["one_of_many"]
        theirs = partial(functional_map, spectrum(mesh), spectrum(other))
        rows.append({"first": first, "second": second} | figures(one_of_many, theirs, "pyfmaps", repeats))
    return rows


def figures(
    ours: Callable[[], float], theirs: Callable[[], object], peer: str, repeats: int
) -> dict[str, Spread]:
    """Return medians and quartiles of our times, the peer's, and their ratios, after one warm-up."""
    times = np.empty((repeats + 1, 2))
    for turn in times:
        turn[0] = ours()
        began = perf_counter()
        theirs()
        turn[1] = perf_counter() - began
    columns = {"ours_ms": 1e3 * times[:, 0], f"{peer}_ms": 1e3 * times[:, 1]}
    columns[f"{peer}_over_ours"] = times[:, 1] / times[:, 0]
    return {name: Spread.of(values[1:].tolist()) for name, values in columns.items()}


def main(folder: Path, collection: Path | None, vertices: int, repeats: int) -> None:
    """Write embeddings.csv and matches.csv."""
    source = read_source(collection)
    with threadpool_limits(limits=1):
        write(folder / "embeddings.csv", embeddings(source, vertices, repeats))
        write(folder / "matches.csv", matches(source, vertices, repeats))


if __name__ == "__main__":
    run(main, __doc__, collection=Path, vertices=3000, repeats=9)
