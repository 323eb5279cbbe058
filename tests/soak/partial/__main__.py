"""`python -m tests.soak.partial DIR --limit 95 --cut 0.3 0.5`: search for parts of models.

Each model in turn is cut by a plane of a direction drawn evenly, and what is left is the query: once against
all models, where the first answer should be the model itself, and once without it, where it should be of its
class.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from core.arrays import Floats
from core.descriptors.partial import describe_part, part_distances
from core.descriptors.spin_images import KEYPOINTS, SPIN_IMAGE_LENGTH
from core.evaluation.perturbation import cut_part
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.datasets import read_collection

SHARES = (0.1, 0.2, 0.3, 0.5, 0.7)


def row(name: str, share: float, nearness: Floats, labels: np.ndarray) -> str:
    """A line of the table; row i of `nearness` is query i, column j model j."""
    own = nearness.diagonal()[:, None]
    rank = (nearness > own).sum(axis=1)
    others = nearness.copy()
    np.fill_diagonal(others, -np.inf)
    nn = (labels[others.argmax(axis=1)] == labels).mean()
    first, three = (rank == 0).mean(), (rank < 3).mean()
    return f"| {share:.0%} | {name} | {first:.3f} | {three:.3f} | {nn:.3f} |"


def main(folder: Path, limit: int, cut: list[float]) -> None:
    collection = read_collection(folder)
    chosen = np.linspace(0, len(collection) - 1, min(limit, len(collection))).astype(int)
    files = [collection[place] for place in chosen]
    labels = np.array([label for _, label in files])
    meshes = [clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh for path, _ in files]
    pipeline = Pipeline(DEFAULT)
    wholes = [pipeline.embed(mesh) for mesh in meshes]
    known = [whole.descriptors["spin_images"][:KEYPOINTS, :SPIN_IMAGE_LENGTH] for whole in wholes]
    print(f"{len(files)} models of {len(set(labels.tolist()))} classes.\n")
    print("| cut away | ranked by | itself first | itself among three | NN without itself |")
    print("|---:|---|---:|---:|---:|", flush=True)
    for share in cut:
        nearness: dict[str, list[Floats]] = {"cc": [], "combined": [], "partial": []}
        for seed, mesh in enumerate(meshes):
            part = cut_part(mesh, share, seed)
            query = pipeline.embed(part)
            scores = pipeline.score(query, wholes)
            nearness["cc"].append(scores.cc)
            nearness["combined"].append(pipeline.combined(query, wholes, scores))
            nearness["partial"].append(-part_distances(describe_part(pipeline.open_surface(part)), known))
        for name, found in nearness.items():
            print(row(name, share, np.array(found), labels), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, default=sys.maxsize)
    parser.add_argument("--cut", type=float, nargs="+", default=SHARES, help="shares of the area")
    main(**vars(parser.parse_args()))
