"""Features of pairs of an incomplete and a whole shape, to fit their class probability."""

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np

from core.arrays import Floats
from core.evaluation.calibration import LabelledPairs
from core.ranking.opinion_pool import PART_FEATURES, part_features
from core.studies.robustness import KINDS, Perturbation
from service.studies.robustness.perturbed_queries import Done, Gallery, Told, on_disk, perturbed_query

SEED = 0

LEVELS = [(kind, amount) for kind in KINDS if kind.part for amount in kind.amounts]
"""Perturbations that make shapes incomplete, and their amounts."""


def part_pairs(pool: Executor, gallery: Gallery, tell: Told, done: Done) -> list[LabelledPairs]:
    """For each of `LEVELS`, the features of shapes that look incomplete after it and of all clean ones."""
    count = len(gallery.files)
    found = []
    with on_disk(gallery) as stored:
        for kind, amount in LEVELS:
            features, asked = np.zeros((count, count, PART_FEATURES)), np.zeros((count, count), dtype=bool)
            rows = pool.map(partial(_features, stored, kind, amount), gallery.files)
            for i, row in enumerate(rows):
                if isinstance(row, str):
                    tell(f"{gallery.files[i]}, {kind.title} {100 * amount:g} %: {row}")
                elif row is not None:
                    features[i], asked[i] = row, True
                done(1)
            found.append(LabelledPairs(gallery.labels, features, asked, weight=1.0 / len(LEVELS)))
    return found


def _features(stored: Path, kind: Perturbation, amount: float, path: Path) -> Floats | str | None:
    """Features of a perturbed file and the gallery, shape (n, PART_FEATURES); None if it looks complete."""
    asked = perturbed_query(stored, kind, amount, SEED, path)
    if isinstance(asked, str):
        return asked
    return part_features(asked.differences) if asked.differences.part.all() else None
