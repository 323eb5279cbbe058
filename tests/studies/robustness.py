"""Retrieval of perturbed queries from a clean collection, and its loss (the paper's Fig. 9).

    python -m tests.studies.robustness DIR COLLECTION [--seeds 3] [--only noise holes] [--limit 38]

Each shape in turn is perturbed and is the query; the unperturbed shape is left out of the ranking. Parts of
shapes (holes, cuts) are also ranked by partial matching. `tau` replaces the fixed number of samples of the
default setting by the paper's sparse ratio, on meshes of at most about 600 vertices.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from core.arrays import Floats
from core.descriptors.partial import describe_part, is_part, part_distances, whole_spin_images
from core.descriptors.spin_images import KEYPOINTS
from core.embedding import Embedding
from core.evaluation.perturbation import cut_part, remove_discs, subdivide
from core.evaluation.retrieval_measures import evaluate
from core.gallery import make_shape
from core.mesh.simplification import decimate
from core.parameters import DEFAULT, Parameters
from core.ranking.class_probability import pooled_log_odds
from service.evaluation.calibration import Perturb, perturbed_query
from service.evaluation.pairwise_scores import embed_files, score_pairs, stored, worker_pool
from service.evaluation.retrieval import Files, collection_files, labels_of, usable
from tests.studies.common import Panel, grid, run, save, write
from tests.studies.perturbation import add_noise, make_soup, separate_parts

TAU = "tau"
TAUS = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)

TAU_VERTICES, TAU_CAP = 600, 480
"""With a sparse ratio, larger meshes are simplified to so many vertices; largest number of samples."""

COLOURS = {"cc": "#0072b2", "combined": "#d55e00", "part": "#009e73"}


@dataclass(frozen=True)
class Kind:
    """A perturbation: its amounts from the mildest on, and those without random numbers."""

    perturb: Perturb
    unit: str
    amounts: tuple[float, ...]
    certain: tuple[float, ...] = ()
    part: bool = False


KINDS = {
    "noise": Kind(add_noise, "% of the diagonal", (0.001, 0.003, 0.005, 0.01)),
    "holes": Kind(remove_discs, "% of the area removed", (0.1, 0.2, 0.3, 0.4), part=True),
    "cut": Kind(cut_part, "% of the area removed", (0.1, 0.2, 0.3, 0.4), part=True),
    "decimation": Kind(decimate, "% of the faces kept", (0.5, 0.25, 0.1)),
    "subdivision": Kind(subdivide, "% of the edges split", (0.5, 1.0), certain=(1.0,)),
    "soup": Kind(make_soup, "% drawn in", (0.0, 0.01, 0.05), certain=(0.0,)),
    "parts": Kind(separate_parts, "% of the diagonal away", (0.005, 0.02)),
}


def tau_parameters(tau: float) -> Parameters:
    """Return the default parameters with the sparse ratio tau, relative to `TAU_VERTICES` vertices."""
    return DEFAULT.with_values(
        name=f"tau {tau}",
        sampling={"samples": 0, "tau": tau, "sample_cap": TAU_CAP},
        mesh={
            "refine_vertices": 0,
            "decimate_above": TAU_VERTICES + 1,
            "decimate_to": TAU_VERTICES,
            "decimate_pieces_above": 0,
            "refine_simplified": 0,
        },
    )


def nearest_neighbour(
    similarities: Mapping[str, Floats], scored: np.ndarray, labels: Sequence[str]
) -> dict[str, float]:
    """Return NN by score: the share of n perturbed queries (rows) whose first of n shapes is of their class.

    A shape without a score, by `scored` of shape (n, n), is ranked last; a query without any is an error. The
    diagonal is not read.
    """
    pairs = scored & ~np.eye(len(labels), dtype=bool)
    shares = {}
    for name, scores in similarities.items():
        matrix = np.full(scores.shape, scores[pairs].min(initial=0.0) - 1.0)
        matrix[pairs] = scores[pairs]
        shares[f"nn_{name}"] = evaluate(matrix, labels, larger_is_closer=True).nn
    return shares


def similarities_of(
    kind: str, embeddings: Path, amount: float, seed: int, path: Path
) -> dict[str, Floats] | str:
    """Return the similarity of a perturbed file to each clean shape by score, or why there is none."""
    asked = perturbed_query(embeddings, KINDS[kind].perturb, amount, seed, path)
    if isinstance(asked, str):
        return asked
    similarities = {"cc": asked.scores.cc, "combined": pooled_log_odds(asked.differences)}
    if KINDS[kind].part:
        images = asked.query.descriptors["spin_images"]
        part = (
            images[KEYPOINTS:] if is_part(images) else describe_part(asked.pipeline.open_surface(asked.mesh))
        )
        descriptors = (embedding.descriptors for embedding in asked.gallery)
        wholes = [whole_spin_images(arrays["spin_images"]) for arrays in descriptors]
        similarities["part"] = -part_distances(part, wholes)
    return similarities


def perturbed(
    pool: Executor, files: Files, embeddings: Path, name: str, amount: float, seed: int
) -> dict[str, float]:
    """Return NN by score, the mean CC with the clean self, and the number of unusable queries."""
    count = len(files)
    similarities: dict[str, Floats] = defaultdict(lambda: np.zeros((count, count)))
    scored = np.zeros((count, count), dtype=bool)
    query = partial(similarities_of, name, embeddings, amount, seed)
    for i, row in enumerate(pool.map(query, [path for path, _ in files])):
        if isinstance(row, str):
            print(f"{files[i][0]}, {name} {amount:g}: {row}", flush=True)
        else:
            for score, values in row.items():
                similarities[score][i] = values
            scored[i] = True
    itself = np.diagonal(similarities["cc"])[np.diagonal(scored)]
    mean = float(itself.mean()) if len(itself) else 0.0
    shares = nearest_neighbour(similarities, scored, labels_of(files))
    return shares | {"cc_itself": mean, "unusable": count - len(itself)}


def with_tau(files: Files, tau: float, workers: int | None) -> dict[str, float]:
    """Return NN by score with gallery and queries embedded under a sparse ratio."""
    count = len(files)
    similarities = {name: np.zeros((count, count)) for name in ("cc", "combined")}
    scored = np.zeros((count, count), dtype=bool)
    with worker_pool(tau_parameters(tau), workers) as pool:
        kept, embeddings = gallery_of(pool, files)
        scores = score_pairs(pool, embeddings, lambda _: None)
    rows = np.ix_(*2 * [[files.index(file) for file in kept]])
    for name, matrix in similarities.items():
        matrix[rows] = getattr(scores, name)
    scored[rows] = True
    return nearest_neighbour(similarities, scored, labels_of(files)) | {"unusable": count - len(kept)}


def gallery_of(pool: Executor, files: Files) -> tuple[Files, list[Embedding]]:
    """Return the files that can be embedded and their embeddings."""
    return usable(files, embed_files(pool, [path for path, _ in files], lambda _: None))


def main(
    folder: Path, collections: list[Path], seeds: int, only: list[str], limit: int | None, workers: int | None
) -> None:
    """Write robustness.csv and its pictures, for the first of the collections."""
    files = collection_files(collections[0], limit)
    rows: list[dict[str, Any]] = []
    row = dict.fromkeys(
        ("perturbation", "amount", "seed", "nn_cc", "nn_combined", "nn_part", "cc_itself", "unusable"), ""
    )
    with worker_pool(DEFAULT, workers) as pool:
        files, embeddings = gallery_of(pool, files)
        scores = score_pairs(pool, embeddings, lambda _: None)
        everything = np.ones(scores.cc.shape, dtype=bool)
        clean = {"cc": scores.cc, "combined": scores.combined}
        figures = nearest_neighbour(clean, everything, labels_of(files))
        rows.append({**row, "perturbation": "none", "amount": 0.0, "seed": 0, **figures})
        with stored(embeddings) as path:
            for name in (name for name in KINDS if name in only):
                for amount in KINDS[name].amounts:
                    for seed in range(1 if amount in KINDS[name].certain else seeds):
                        figures = perturbed(pool, files, path, name, amount, seed)
                        rows.append({**row, "perturbation": name, "amount": amount, "seed": seed, **figures})
    for tau in TAUS if TAU in only else ():
        figures = with_tau(files, tau, workers)
        rows.append({**row, "perturbation": TAU, "amount": tau, "seed": 0, **figures})
    write(folder / "robustness.csv", rows)
    save(curves(rows), folder / "robustness.png")
    mesh = make_shape("person", 0)
    panels = [Panel(mesh, "clean")]
    panels += [Panel(kind.perturb(mesh, kind.amounts[-1], 0), name) for name, kind in KINDS.items()]
    save(grid([panels[:4], panels[4:]]), folder / "robustness-shapes.png")


def curves(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Return a chart for each perturbation: NN against amount, with bars over the range of the seeds."""
    names = list(dict.fromkeys(row["perturbation"] for row in rows[1:])) or ["none"]
    figure = Figure(figsize=(2.9 * len(names) + 0.6, 3.0), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False, sharey=True)[0], names, strict=True):
        amounts = list(dict.fromkeys(row["amount"] for row in rows if row["perturbation"] == name))
        for score, colour in COLOURS.items():
            values = [
                [row[f"nn_{score}"] for row in rows if (row["perturbation"], row["amount"]) == (name, amount)]
                for amount in amounts
            ]
            if "" in values[0]:
                continue
            means = np.array([np.mean(seeds) for seeds in values])
            ends = np.array([[min(seeds), max(seeds)] for seeds in values]).T
            bars = [means - ends[0], ends[1] - means]
            axes.errorbar(
                range(len(amounts)), means, yerr=bars, color=colour, marker="o", capsize=3, label=score
            )
            if score != "part":
                axes.axhline(rows[0][f"nn_{score}"], color=colour, linestyle=":", linewidth=1)
        axes.set_xticks(
            range(len(amounts)), [f"{amount if name == TAU else 100 * amount:g}" for amount in amounts]
        )
        axes.set(title=name, xlabel=KINDS[name].unit if name in KINDS else "", ylim=(0.0, 1.02))
    axes.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    run(main, __doc__, collections="folders", seeds=3, only=(*KINDS, TAU), limit=int, workers=int)
