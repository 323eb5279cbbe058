"""Embeddings and scores of five shapes are those of METHOD_VERSION.

`method_version.json` holds, for the version that it names, one number for each array: its projection onto a
fixed random vector. Rounding of another processor moves the number by less than `TOLERANCE`, and any change
of the method by more. After a change that moves an embedding or a score, raise `METHOD_VERSION` in
`core/parameters.py`, and renew the file:

    python -m tests.core.test_method_version
"""

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.descriptors import views
from core.embedding import Embedding
from core.evaluation.perturbation import cut_part
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT, METHOD_VERSION, PAPER, Parameters
from core.pipeline import Pipeline
from tests.core.shapes import blob, box, loose_parts

FILE = Path(__file__).with_name("method_version.json")


def lopsided(mesh: Mesh) -> Mesh:
    """Return a mesh without symmetries, whose eigenfunctions have signs that rounding does not decide."""
    size = np.abs(mesh.vertices).max()
    x, y, z = (mesh.vertices / size).T
    bent = np.stack([x + 0.3 * y * y, y + 0.2 * x * z, 0.8 * z + 0.25 * x * x + 0.1 * y], axis=1)
    return Mesh(size * bent, mesh.faces)


SHAPES = {
    "blob": lambda: blob(0, 2),
    "box": lambda: box(3, 2, 1),
    "loose parts": loose_parts,
    "fine blob": lambda: blob(1, 4),
    "part of a blob": lambda: cut_part(blob(2, 3), 0.4, 0),
}

SETTINGS = {"default": DEFAULT, "paper": PAPER.with_values(sampling={"sample_cap": 60})}

TOLERANCE = 1e-4
"""Relative to the length of the array: the part of a projection that rounding may move. Other kernels of
OpenBLAS (`OPENBLAS_CORETYPE`) move it by 1e-9."""

PAIR_TOLERANCE = 0.02
"""The same of sim and SSD: rounding may decide whether two samples are a pair."""

Projections = Mapping[str, float]


def projection(name: str, array: NDArray[Any]) -> float:
    """Return the projection of an array onto a random vector, over the length of the array."""
    values = np.asarray(array, dtype=np.float64).ravel()
    direction = np.random.default_rng(zlib.crc32(f"{name}{values.shape}".encode())).normal(size=values.size)
    return float(direction @ values / max(np.linalg.norm(values), 1e-12))


def arrays_of(embedding: Embedding) -> dict[str, NDArray[Any]]:
    """Return the arrays of an embedding, without `vertices`: a sample amid an edge has two nearest ones."""
    arrays = {
        "facts": np.array(list(vars(embedding.facts).values())),
        "positions": embedding.positions,
        "graph_edges": embedding.graph_edges,
        "graph_lengths": embedding.graph_lengths,
        "tree_edges": embedding.tree_edges,
        "regions": embedding.regions,
        "signature": embedding.signature,
        "orientation": embedding.orientation,
        "pieces": embedding.pieces,
        **embedding.descriptors,
    }
    for spectrum in embedding.spectra:
        arrays[f"{spectrum.name} eigenvalues"] = spectrum.eigenvalues
        arrays[f"{spectrum.name} coordinates"] = spectrum.coordinates
    return arrays


def projections(parameters: Parameters) -> dict[str, float]:
    """Return the projections of the embeddings of all shapes, and of the scores of their pairs."""
    pipeline = Pipeline(parameters)
    embeddings = {name: pipeline.embed(lopsided(make())) for name, make in SHAPES.items()}
    arrays = {
        f"{shape}: {name}": array
        for shape, embedding in embeddings.items()
        for name, array in arrays_of(embedding).items()
    }
    others = list(embeddings.values())
    for shape, embedding in embeddings.items():
        scores = pipeline.score(embedding, others)
        arrays |= {f"{shape}: {name}": scored for name, scored in vars(scores).items()}
        arrays[f"{shape}: combined"] = pipeline.combined(embedding, others, scores)
    return {name: projection(name, array) for name, array in arrays.items()}


def moved(before: Projections, after: Projections) -> list[str]:
    """Return the names of the arrays that differ, or that only one of the two has."""
    return sorted(
        name
        for name in before.keys() | after.keys()
        if not abs(before.get(name, np.inf) - after.get(name, np.inf))
        <= (PAIR_TOLERANCE if name.endswith((": sim", ": ssd", "network_views")) else TOLERANCE)
    )


@pytest.mark.parametrize("setting", SETTINGS)
def test_what_moves_an_embedding_or_a_score_raises_the_method_version(setting: str) -> None:
    stored = json.loads(FILE.read_text())
    assert stored["version"] == METHOD_VERSION, f"renew {FILE.name}: see the top of this file"
    differing = moved(stored[setting], projections(SETTINGS[setting]))
    assert not differing, f"raise METHOD_VERSION and renew {FILE.name}: {', '.join(differing)} differ"


def test_a_small_change_of_the_method_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    stored = json.loads(FILE.read_text())["default"]
    monkeypatch.setattr(views, "PAIR_WEIGHT", 1.01 * views.PAIR_WEIGHT)
    slower = DEFAULT.with_values(spectral={"eigenvalue_power": 0.502})
    differing = {name.split(": ")[1] for name in moved(stored, projections(slower))}
    assert {"affinity coordinates", "laplace-beltrami coordinates", "combined"} <= differing
    assert not differing & {"positions", "regions", "signature", "spin_images", "views"}


def renew() -> None:
    """Write the projections of this version.

    Raises
    ------
    SystemExit
        A projection moved, and `METHOD_VERSION` is that of the file.
    """
    found = {setting: projections(parameters) for setting, parameters in SETTINGS.items()}
    stored = json.loads(FILE.read_text()) if FILE.exists() else {"version": 0}
    if stored["version"] == METHOD_VERSION and any(moved(stored[name], found[name]) for name in SETTINGS):
        raise SystemExit("an embedding or a score moved: raise METHOD_VERSION in core/parameters.py")
    rounded = {
        setting: {name: round(value, 6) for name, value in sorted(projected.items())}
        for setting, projected in found.items()
    }
    FILE.write_text(json.dumps({"version": METHOD_VERSION, **rounded}, indent=1) + "\n")


if __name__ == "__main__":
    renew()
