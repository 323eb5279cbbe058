"""The results of a calibration on labelled collections."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from core.arrays import Floats
from core.evaluation.calibration import LabelledPairs, Reliability, fit, leave_class_out, reliability
from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.ranking.class_probability import Calibration

UPPER = 5
"""The first bin of pairs whose class probability exceeds one half."""


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
    """The model of all pairs, and the errors of the models fitted without each class.

    Attributes
    ----------
    model : Calibration
    without_patches : Calibration
        The model without the features of spin images.
    collections : tuple of Judged
    together : Reliability
        Over all collections, each with the same weight.
    incomplete : Incomplete
    """

    model: Calibration
    without_spin_images: Calibration
    collections: tuple[Judged, ...]
    together: Reliability
    incomplete: Incomplete

    def as_json(self) -> dict[str, object]:
        """The object that `--json` prints."""
        return {
            **asdict(self.model),
            "without_patches": asdict(self.without_spin_images),
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


def study(
    names: Sequence[str], collections: Sequence[LabelledPairs], incomplete: Sequence[Sequence[LabelledPairs]]
) -> CalibrationStudy:
    """Fit the model to all pairs, and judge each class by the model fitted without it.

    Parameters
    ----------
    names : sequence of str
    collections : sequence of LabelledPairs
        One per name, with the features of `core.ranking.class_probability.spin_image_features`.
    incomplete : sequence of sequence of LabelledPairs
        Several per name, with the features of `core.ranking.class_probability.part_features`.

    Raises
    ------
    ParameterError
        Without one of the classes, all pairs have the same label.
    """
    probabilities = leave_class_out(collections)
    return CalibrationStudy(
        model=fit(collections),
        without_spin_images=fit([replace(one, features=one.features[..., :-1]) for one in collections]),
        collections=tuple(
            _judged(name, collection, given)
            for name, collection, given in zip(names, collections, probabilities, strict=True)
        ),
        together=reliability(collections, probabilities),
        incomplete=_incomplete([one for several in incomplete for one in several]),
    )


def _incomplete(collections: Sequence[LabelledPairs]) -> Incomplete:
    probabilities = leave_class_out(collections)
    right: list[bool] = []
    for collection, given in zip(collections, probabilities, strict=True):
        codes, pairs = collection.codes, collection.both_ways
        asked = np.flatnonzero(pairs.any(axis=1))
        first = np.where(pairs, given, -1.0).argmax(axis=1)
        right += (codes[first[asked]] == codes[asked]).tolist()
    return Incomplete(
        model=fit(collections),
        queries=len(right),
        nn=float(np.mean(right)),
        reliability=reliability(collections, probabilities),
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
