"""The results of a calibration on labelled collections."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from core.arrays import Floats
from core.evaluation.calibration import (
    LabelledPairs,
    Reliability,
    fit,
    leave_class_out,
    reliability,
)
from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.ranking.opinion_pool import Calibration

UPPER = 1
"""The first bin of pairs whose class probability exceeds 0.1: most of the others clearly have two classes."""


@dataclass(frozen=True, eq=False)
class Judged:
    """One collection, with probabilities of each pair by the fit without its query's class.

    Attributes
    ----------
    name : str
    shapes, classes : int
    figures : Evaluation
        Evaluation of the ranking by these probabilities.
    reliability : Reliability
    """

    name: str
    shapes: int
    classes: int
    figures: Evaluation
    reliability: Reliability


@dataclass(frozen=True, eq=False)
class Incomplete:
    """Pairs of an incomplete shape and a whole shape, judged likewise.

    Attributes
    ----------
    model : Calibration
    queries : int
        Number of incomplete shapes.
    nn : float
        Share of them whose most probable whole shape, except their own, is of their class.
    reliability : Reliability
        Over all perturbations and collections, each with the same weight.
    """

    model: Calibration
    queries: int
    nn: float
    reliability: Reliability


@dataclass(frozen=True, eq=False)
class CalibrationStudy:
    """The models of all pairs, and the errors of the models fitted without each class.

    Attributes
    ----------
    model : Calibration
        Of complete pairs.
    collections : tuple of Judged
        By both models, each for its pairs.
    together : Reliability
        Over all collections, each with the same weight.
    incomplete : Incomplete
    """

    model: Calibration
    collections: tuple[Judged, ...]
    together: Reliability
    incomplete: Incomplete

    def as_json(self) -> dict[str, object]:
        """The object that `--json` prints."""
        return {
            **asdict(self.model),
            "incomplete": {
                **asdict(self.incomplete.model),
                "queries": self.incomplete.queries,
                "nn": self.incomplete.nn,
                **_numbers(self.incomplete.reliability),
            },
            "together": _numbers(self.together),
            "collections": [
                {
                    "name": one.name,
                    "shapes": one.shapes,
                    "classes": one.classes,
                    **{name: getattr(one.figures, name) for name in ("nn", "ft", "st")},
                    **_numbers(one.reliability),
                }
                for one in self.collections
            ],
        }


@dataclass(frozen=True, eq=False)
class CollectionPairs:
    """The pairs of a labelled collection.

    Attributes
    ----------
    complete : LabelledPairs
        Of complete shapes, with the features of `core.ranking.opinion_pool.features`.
    incomplete : LabelledPairs
        With an incomplete shape, with the features of `core.ranking.opinion_pool.part_features`.
    perturbed : sequence of LabelledPairs
        Of shapes that were made incomplete, and complete ones, with the same features.
    """

    complete: LabelledPairs
    incomplete: LabelledPairs
    perturbed: Sequence[LabelledPairs]


def study(names: Sequence[str], collections: Sequence[CollectionPairs]) -> CalibrationStudy:
    """Fit the models to all pairs, and judge each class by models fitted without it.

    Raises
    ------
    ParameterError
        Without one of the classes, all pairs have the same label.
    """
    complete, incomplete = [one.complete for one in collections], [one.incomplete for one in collections]
    perturbed = [pairs for one in collections for pairs in one.perturbed]
    of_complete = leave_class_out(complete)
    of_parts = leave_class_out([*incomplete, *perturbed])
    of_incomplete, of_perturbed = of_parts[: len(incomplete)], of_parts[len(incomplete) :]
    whole = [
        (replace(pairs, asked=None), np.where(parts.both_ways, given, found))
        for pairs, parts, found, given in zip(complete, incomplete, of_complete, of_incomplete, strict=True)
    ]
    return CalibrationStudy(
        model=fit(complete),
        collections=tuple(_judged(name, *one) for name, one in zip(names, whole, strict=True)),
        together=reliability([pairs for pairs, _ in whole], [found for _, found in whole]),
        incomplete=_incomplete(perturbed, of_perturbed, fit([*incomplete, *perturbed])),
    )


def _incomplete(
    perturbed: Sequence[LabelledPairs], probabilities: Sequence[Floats], model: Calibration
) -> Incomplete:
    right: list[bool] = []
    for collection, given in zip(perturbed, probabilities, strict=True):
        codes, pairs = collection.codes, collection.both_ways
        asked = np.flatnonzero(pairs.any(axis=1))
        first = np.where(pairs, given, -1.0).argmax(axis=1)
        right += (codes[first[asked]] == codes[asked]).tolist()
    return Incomplete(
        model=model,
        queries=len(right),
        nn=float(np.mean(right)),
        reliability=reliability(perturbed, probabilities),
    )


def _judged(name: str, collection: LabelledPairs, probabilities: Floats) -> Judged:
    return Judged(
        name=name,
        shapes=len(collection.labels),
        classes=len(set(collection.labels)),
        figures=evaluate(probabilities, collection.labels, larger_is_closer=True),
        reliability=reliability([collection], [probabilities]),
    )


def _numbers(found: Reliability) -> dict[str, object]:
    return {
        "base_rate": found.base_rate,
        "error": found.error,
        "error_upper": found.error_above(UPPER),
        **{key: np.asarray(getattr(found, key)).tolist() for key in ("share", "said", "found")},
    }
