"""`python -m tests.soak.likeness.collections DIR...`: the likeness of all pairs of labelled collections.

For pairs of one class and for pairs of two classes it prints the shares that are poses, similar and weak, the
shares that other thresholds would call poses, and the shares that are as probable. Nothing is registered:
rigid copies count as poses.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.parameters import DEFAULT
from core.ranking.class_probability import pooled_log_odds
from core.ranking.likeness import NEAR_ISOMETRIC, POSE_CC, SIMILAR
from core.ranking.local_density import typical_densities
from service.datasets import read_collection
from service.evaluation.pairwise_scores import PairScores
from service.evaluation.retrieval import score_collection

THRESHOLDS = [(near, POSE_CC) for near in (0.025, NEAR_ISOMETRIC, 0.04, 0.05)] + [
    (NEAR_ISOMETRIC, cc) for cc in (0.0, 0.97, 0.99)
]
"""Spectral distances and values of CC that are tried as thresholds of a pose."""

PROBABILITIES = (0.1, 0.2, 0.3, SIMILAR, 0.7)
"""Class probabilities that are tried as the threshold of similar shapes."""


def poses(spectral: NDArray[np.float64], scores: PairScores, near: float, cc: float) -> NDArray[np.bool_]:
    """The pairs that two thresholds call poses, shape (n, n)."""
    return (spectral <= near) & (scores.cc >= cc)


def rows(name: str, labels: list[str], scores: PairScores) -> tuple[list[str], list[str], list[str]]:
    """Two rows of each table: pairs of one class, and of two classes."""
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
    similar = probability >= SIMILAR
    pose = poses(spectral, scores, NEAR_ISOMETRIC, POSE_CC)
    told, tried, probable = [], [], []
    for kind, chosen in (("one class", once & one_class), ("two classes", once & ~one_class)):
        shares = [pose[chosen].mean(), (similar & ~pose)[chosen].mean(), (~similar & ~pose)[chosen].mean()]
        told.append(f"| {name} | {kind} | {chosen.sum():,} | {_percent(shares)} |")
        tried.append(
            f"| {name} | {kind} | "
            + _percent([poses(spectral, scores, near, cc)[chosen].mean() for near, cc in THRESHOLDS])
            + " |"
        )
        shares = [(probability[chosen] >= least).mean() for least in PROBABILITIES]
        probable.append(f"| {name} | {kind} | {_percent(shares)} |")
    return told, tried, probable


def main(folders: list[Path], workers: int) -> None:
    """Print the tables."""
    told = ["| collection | pairs of | pairs | pose | similar | weak |", "|---|---|---:|---:|---:|---:|"]
    tried = [
        f"| collection | pairs of | {' | '.join(f'{near:g} and cc {cc:g}' for near, cc in THRESHOLDS)} |",
        f"|---|---|{'---:|' * len(THRESHOLDS)}",
    ]
    probable = [
        f"| collection | pairs of | {' | '.join(f'at least {least:g}' for least in PROBABILITIES)} |",
        f"|---|---|{'---:|' * len(PROBABILITIES)}",
    ]
    for folder in folders:
        found = rows(folder.name, *score_collection(read_collection(folder), DEFAULT, workers))
        for table, more in zip((told, tried, probable), found, strict=True):
            table.extend(more)
    print("\n".join([*told, "", *tried, "", *probable]))


def _percent(shares: list[float]) -> str:
    return " | ".join(f"{100 * share:.2f} %" for share in shares)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.soak.likeness.collections", description=__doc__)
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    main(given.folders, given.workers)
