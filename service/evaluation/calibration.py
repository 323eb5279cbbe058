"""The calibration of `combined`: labelled pairs in; models, and their errors on unseen classes, out."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from core.arrays import Floats
from core.evaluation.calibration import BINS, LabelledPairs, Reliability, fit, leave_class_out, reliability
from core.evaluation.perturbation import cut_part, remove_discs
from core.evaluation.retrieval_measures import evaluate
from core.ranking.class_probability import PART_FEATURES, Calibration, features, offset, part_features
from service.evaluation.pairwise_scores import Done, PairScores, stored
from service.evaluation.perturbed_queries import Gallery, Perturb, Told, perturbed_query

UPPER = 1
"""The first bin of pairs whose class probability exceeds 0.1: most of the others clearly have two classes."""

LEVELS: list[tuple[Perturb, float]] = [
    (perturb, amount) for perturb in (remove_discs, cut_part) for amount in (0.1, 0.2, 0.3, 0.4)
]
"""Perturbations that make shapes incomplete, and the shares of the area that they remove."""

DIGITS = 4
"""Decimals of the constants that the command prints."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Pairs with probabilities by the fit without their query's class.

    Attributes
    ----------
    name : str
    shapes, classes : int
        Numbers of queries and of their classes; 0 classes where several collections are together.
    figures : dict of str to float
        NN, FT and ST of the ranking by these probabilities; of incomplete shapes NN alone, by which the most
        probable whole shape, except their own, is of their class.
    reliability : Reliability
    """

    name: str
    shapes: int
    classes: int
    figures: dict[str, float]
    reliability: Reliability

    def row(self) -> tuple[str, ...]:
        """Return the row of a table."""
        numbers = (str(self.shapes), str(self.classes or ""), *_errors(self.reliability))
        return (self.name, *numbers, *(f"{figure:.3f}" for figure in self.figures.values()))


@dataclass(frozen=True, eq=False)
class CalibrationStudy:
    """The models of all pairs, and the errors of the models fitted without each class.

    Attributes
    ----------
    model, part_model : Calibration
        Of complete pairs, and of pairs with an incomplete shape.
    collections : tuple of Judged
        By both models, each for its pairs.
    together : Reliability
        Over all collections, each with the same weight.
    incomplete : Judged
        Shapes made incomplete, and whole shapes, over all perturbations and collections.
    """

    model: Calibration
    part_model: Calibration
    collections: tuple[Judged, ...]
    together: Reliability
    incomplete: Judged

    def as_json(self) -> dict[str, object]:
        """Return the object that `--json` prints."""
        parts = self.incomplete
        counts = {"queries": parts.shapes, **parts.figures}
        return {
            **asdict(self.model),
            "incomplete": {**asdict(self.part_model), **counts, **_numbers(parts.reliability)},
            "together": _numbers(self.together),
            "collections": [
                {"name": judged.name, "shapes": judged.shapes, "classes": judged.classes, **judged.figures}
                | _numbers(judged.reliability)
                for judged in self.collections
            ],
        }

    def constants(self) -> str:
        """Return the assignments that `core/ranking/class_probability.py` holds."""
        models = {"CALIBRATED_POOL": self.model, "CALIBRATED_PARTS": self.part_model}
        return "\n".join(f"{name} = {_constant(model)}" for name, model in models.items())


@dataclass(frozen=True, eq=False)
class CollectionPairs:
    """The pairs of a labelled collection.

    Those of complete shapes have the features of `core.ranking.class_probability.features`; those with an
    incomplete shape, and those of shapes made incomplete with complete ones, have its `part_features`.
    """

    complete: LabelledPairs
    incomplete: LabelledPairs
    perturbed: Sequence[LabelledPairs]

    @classmethod
    def of(
        cls, labels: Sequence[str], scores: PairScores, perturbed: Sequence[LabelledPairs]
    ) -> "CollectionPairs":
        """Compute the features of all scored pairs."""
        differences = scores.differences
        return cls(
            LabelledPairs(tuple(labels), features(differences), ~differences.part, offset(differences)),
            LabelledPairs(tuple(labels), part_features(differences), differences.part),
            perturbed,
        )


def part_pairs(pool: Executor, gallery: Gallery, tell: Told, done: Done) -> list[LabelledPairs]:
    """Return for each of `LEVELS` the features of shapes that look incomplete after it and of clean ones."""
    count = len(gallery.files)
    levels = []
    with stored(list(gallery.embeddings)) as embeddings:
        for perturb, amount in LEVELS:
            pairs, asked = np.zeros((count, count, PART_FEATURES)), np.zeros((count, count), dtype=bool)
            rows = pool.map(partial(_part_features, embeddings, perturb, amount), gallery.files)
            for i, row in enumerate(rows):
                if isinstance(row, str):
                    tell(f"{gallery.files[i]}, {perturb.__name__} {100 * amount:g} %: {row}")
                elif row is not None:
                    pairs[i], asked[i] = row, True
                done(1)
            levels.append(LabelledPairs(gallery.labels, pairs, asked, weight=1.0 / len(LEVELS)))
    return levels


def study(names: Sequence[str], collections: Sequence[CollectionPairs]) -> CalibrationStudy:
    """Fit the models to all pairs, and judge each class by models fitted without it.

    Raises
    ------
    ParameterError
        Without one of the classes, all pairs have the same label.
    """
    complete = [pairs.complete for pairs in collections]
    incomplete = [pairs.incomplete for pairs in collections]
    perturbed = [level for pairs in collections for level in pairs.perturbed]
    of_complete = leave_class_out(complete)
    of_parts = leave_class_out([*incomplete, *perturbed])
    of_incomplete, of_perturbed = of_parts[: len(incomplete)], of_parts[len(incomplete) :]
    whole = [
        (replace(pairs, asked=None), np.where(parts.both_ways, of_part, of_whole))
        for pairs, parts, of_whole, of_part in zip(
            complete, incomplete, of_complete, of_incomplete, strict=True
        )
    ]
    return CalibrationStudy(
        model=fit(complete),
        part_model=fit([*incomplete, *perturbed]),
        collections=tuple(_judged(name, *pairs) for name, pairs in zip(names, whole, strict=True)),
        together=reliability([pairs for pairs, _ in whole], [probability for _, probability in whole]),
        incomplete=_incomplete(perturbed, of_perturbed),
    )


def summary(judged: CalibrationStudy) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings, a row for all collections together, one for each, and one for incomplete shapes."""
    headings = ("collection", "shapes", "classes", "base rate", "error", f"error above {UPPER / BINS:g}")
    together = ("all together", "", "", *_errors(judged.together), "", "", "")
    rows = [together, *(collection.row() for collection in judged.collections)]
    return (*headings, "NN", "FT", "ST"), [*rows, (*judged.incomplete.row(), "", "")]


def _part_features(embeddings: Path, perturb: Perturb, amount: float, path: Path) -> Floats | str | None:
    """Return features of a perturbed file and the gallery, (n, PART_FEATURES); None if it looks complete."""
    asked = perturbed_query(embeddings, perturb, amount, 0, path)
    if isinstance(asked, str):
        return asked
    return part_features(asked.differences) if asked.differences.part.all() else None


def _incomplete(perturbed: Sequence[LabelledPairs], probabilities: Sequence[Floats]) -> Judged:
    right: list[bool] = []
    for collection, probability in zip(perturbed, probabilities, strict=True):
        codes, pairs = collection.codes, collection.both_ways
        asked = np.flatnonzero(pairs.any(axis=1))
        first = np.where(pairs, probability, -1.0).argmax(axis=1)
        right += (codes[first[asked]] == codes[asked]).tolist()
    figures = {"nn": float(np.mean(right))}
    return Judged("incomplete shapes", len(right), 0, figures, reliability(perturbed, probabilities))


def _judged(name: str, collection: LabelledPairs, probabilities: Floats) -> Judged:
    labels = collection.labels
    measures = evaluate(probabilities, labels, larger_is_closer=True)
    figures = {"nn": measures.nn, "ft": measures.ft, "st": measures.st}
    return Judged(name, len(labels), len(set(labels)), figures, reliability([collection], [probabilities]))


def _constant(model: Calibration) -> str:
    slopes = ", ".join(f"{slope:.{DIGITS}f}" for slope in model.slopes)
    slopes += "," if len(model.slopes) == 1 else ""
    return f"Calibration(intercept={model.intercept:.{DIGITS}f}, slopes=({slopes}))"


def _errors(judged: Reliability) -> tuple[str, str, str]:
    return f"{judged.base_rate:.3f}", f"{judged.error:.4f}", f"{judged.error_above(UPPER):.3f}"


def _numbers(judged: Reliability) -> dict[str, object]:
    return {
        "base_rate": judged.base_rate,
        "error": judged.error,
        "error_upper": judged.error_above(UPPER),
        **{key: np.asarray(getattr(judged, key)).tolist() for key in ("share", "said", "found")},
    }
