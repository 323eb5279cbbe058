"""Search for parts of models among the whole ones.

    python -m tests.studies.partial DIR COLLECTION [--limit 95] [--cut 0.3 0.5]

Each model in turn is cut by a plane of a direction drawn evenly, and the rest is the query: once against all
models, where the first answer should be the model itself, and once without it, where it should be of its
class.
"""

from pathlib import Path

import numpy as np

from core.arrays import Floats
from core.descriptors.partial import describe_part, part_distances, whole_spin_images
from core.evaluation.perturbation import cut_part
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.datasets import read_collection
from tests.studies.common import run, write

SHARES = (0.1, 0.2, 0.3, 0.5, 0.7)
"""Shares of the area that are cut away."""


def figures(similarities: Floats, labels: np.ndarray) -> dict[str, float]:
    """Return how often the model itself is the first and among three, and NN without it.

    Row i of `similarities`, of shape (n, n), is query i, column j model j.
    """
    rank = (similarities > similarities.diagonal()[:, None]).sum(axis=1)
    others = np.where(np.eye(len(labels), dtype=bool), -np.inf, similarities)
    nn = (labels[others.argmax(axis=1)] == labels).mean()
    return {"itself_first": (rank == 0).mean(), "itself_in_three": (rank < 3).mean(), "nn_of_class": nn}


def main(folder: Path, collections: list[Path], limit: int, cut: list[float]) -> None:
    """Write partial.csv, for the first of the collections."""
    collection = read_collection(collections[0])
    chosen = np.linspace(0, len(collection) - 1, min(limit, len(collection))).astype(int)
    files = [collection[place] for place in chosen]
    labels = np.array([label for _, label in files])
    meshes = [clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh for path, _ in files]
    pipeline = Pipeline(DEFAULT)
    wholes = [pipeline.embed(mesh) for mesh in meshes]
    spin_images = [whole_spin_images(whole.descriptors["spin_images"]) for whole in wholes]
    rows = []
    for share in cut:
        similarities: dict[str, list[Floats]] = {"cc": [], "combined": [], "partial": []}
        for seed, mesh in enumerate(meshes):
            part = cut_part(mesh, share, seed)
            query = pipeline.embed(part)
            scores = pipeline.score(query, wholes)
            similarities["cc"].append(scores.cc)
            similarities["combined"].append(pipeline.combined(query, wholes, scores))
            part_images = describe_part(pipeline.open_surface(part))
            similarities["partial"].append(-part_distances(part_images, spin_images))
        for name, values in similarities.items():
            rows.append({"cut_away": share, "ranked_by": name} | figures(np.array(values), labels))
    write(folder / "partial.csv", rows)


if __name__ == "__main__":
    run(main, __doc__, collections="folders", limit=95, cut=SHARES)
