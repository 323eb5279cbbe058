"""Likeness of 200 pairs of shapes made by code, by a running service, and of all pairs of collections.

    python -m tests.studies.likeness DIR [--seed 0] [--each 30] [--collection COLLECTION]

Exits with status 1 if fewer than 95 % of the planted pairs get a right likeness, or a copy a wrong scale.
With a collection, thresholds.csv has the shares of its pairs that several thresholds call poses or similar,
where nothing is registered: rigid copies count as poses.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import expit

from core.gallery import CLASSES
from core.gallery.bodies import make_body
from core.io import write_mesh
from core.parameters import DEFAULT
from core.ranking.class_probability import pooled_log_odds
from core.ranking.likeness import NEAR_ISOMETRIC, POSE_CC, SIMILAR, Likeness
from core.ranking.local_density import typical_densities
from service.evaluation.pairwise_scores import default_workers
from service.evaluation.retrieval import collection_files, score_collection
from tests.studies.common import run, write
from tests.studies.copies import copy, moved
from tests.studies.planted import PlantedPair, compared, write_table

ARTICULATED = ("bird", "fish", "hand", "octopus", "person", "quadruped", "snake", "spider", "teddy")
"""Classes whose poses are far from rigid copies."""

FACTORS = (0.3, 1.5, 2.5, 25.4)
OTHER_MESH = (1800, 3500)
"""Approximate numbers of vertices of other meshes of a body, which has 2,500."""

RIGHT, SCALE = 0.95, 0.02
"""Least share of right pairs, and largest relative error of a scale: that of a coarse mesh is less exact."""

KINDS: dict[str, frozenset[Likeness]] = {
    "turned": frozenset({"same"}),
    "scaled": frozenset({"scaled"}),
    "remeshed": frozenset({"same"}),
    "mirrored": frozenset({"mirrored", "same"}),
    "posed": frozenset({"pose"}),
    "another individual": frozenset({"similar"}),
    "another class": frozenset({"weak"}),
}
"""Each kind of planted pair with the right likenesses; some bodies are their own mirror images."""

THRESHOLDS = [(near, POSE_CC) for near in (0.025, NEAR_ISOMETRIC, 0.04, 0.05)] + [
    (NEAR_ISOMETRIC, cc) for cc in (0.0, 0.97, 0.99)
]
"""Spectral distances and values of CC that are tried as thresholds of a pose."""

PROBABILITIES = (0.1, 0.2, 0.3, SIMILAR, 0.7)
"""Class probabilities that are tried as the threshold of similar shapes."""


def planted_pairs(seed: int, each: int) -> Iterator[PlantedPair]:
    """Yield pairs of each kind, of bodies that no other pair has; another seed gives other bodies."""
    body = 1000 * seed
    for kind in KINDS:
        labels = ARTICULATED if kind == "posed" else CLASSES
        for number in range(min(each, 20) if kind == "mirrored" else each):
            yield planted(kind, labels[number % len(labels)], body)
            body += 1


def planted(kind: str, label: str, body: int) -> PlantedPair:
    """Return one pair: a body of a class, and a copy, another pose, individual or class."""
    first = make_body(label, body).posed(0)
    other_mesh, scale, name = OTHER_MESH[body % 2], 1.0, f"{label}-{body}"
    match kind:
        case "turned":
            second = moved(first, body)
        case "scaled":
            scale = FACTORS[body % len(FACTORS)]
            second = moved(first, body, scale=scale)
        case "remeshed":
            how = ("split", "simplified", "other mesh")[body % 3]
            name = f"{name}, {how}"
            if how == "other mesh":
                first = make_body(label, body).rest
                second = moved(make_body(label, body, vertices=other_mesh).rest, body)
            else:
                second = copy(first, how, body)
        case "mirrored":
            second = moved(first, body, mirrored=True)
        case "posed":
            second = make_body(label, body, vertices=other_mesh).posed(1)
        case "another individual":
            second = make_body(label, body + 500, vertices=other_mesh).posed(1)
        case _:
            step = 1 + body % (len(CLASSES) - 1)
            other = CLASSES[(CLASSES.index(label) + step) % len(CLASSES)]
            name, second = f"{label} {other} {body}", make_body(other, body).posed(1)
    files = write_mesh(first, "off"), write_mesh(second, "off")
    known_scale = scale if kind in {"turned", "scaled", "remeshed"} else None
    return PlantedPair(kind, name, files, KINDS[kind], known_scale)


def thresholds(collection: Path, workers: int) -> list[dict[str, object]]:
    """Return the shares of pairs of one class and of two that each threshold calls poses or similar."""
    labels, scores = score_collection(collection_files(collection, None), DEFAULT, workers)
    spectral, classes = scores.differences.spectral, np.array(labels)
    once = np.triu(np.ones_like(spectral, dtype=bool), 1)
    one_class = classes[:, None] == classes[None, :]
    densities = typical_densities(1)
    alone = replace(
        scores.differences,
        spectral_density=np.full_like(spectral, densities.spectral[0]),
        view_density=np.full_like(spectral, densities.view[0]),
    )
    probability = expit(np.maximum(scores.combined, pooled_log_odds(alone)))
    rows: list[dict[str, object]] = []
    for kind, chosen in (("one class", once & one_class), ("two classes", once & ~one_class)):
        row: dict[str, object] = {"collection": collection.name, "pairs_of": kind, "pairs": int(chosen.sum())}
        for near, cc in THRESHOLDS:
            row[f"pose_{near:g}_{cc:g}"] = ((spectral <= near) & (scores.cc >= cc))[chosen].mean()
        for least in PROBABILITIES:
            row[f"similar_{least:g}"] = (probability[chosen] >= least).mean()
        rows.append(row)
    return rows


def main(folder: Path, seed: int, each: int, collection: Path | None, workers: int) -> bool:
    """Write likeness.csv; return whether enough pairs are right, and every scale."""
    if collection is not None:
        write(folder / "thresholds.csv", thresholds(collection, workers))
    answers = compared(planted_pairs(seed, each))
    write_table(folder / "likeness.csv", answers)
    right = sum(answer.right for answer in answers)
    print(f"{right} of {len(answers)} pairs have a right likeness.")
    return right >= RIGHT * len(answers) and all(answer.error <= SCALE for answer in answers)


if __name__ == "__main__":
    run(main, __doc__, seed=0, each=30, collection=Path, workers=default_workers())
