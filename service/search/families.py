"""The families of the stored shapes, from the graph of neighbours."""

from collections import defaultdict

import numpy as np
from scipy.special import logit

from core.ranking.families import families
from service.index.neighbour_repository import count_lacking
from service.search.neighbours import rows_of
from service.search.schemas import FamiliesAnswer, Family
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, ShapeRecord
from service.shapes.schemas import Shape
from service.storage.database import ReadSession

RECORDS_AT_ONCE = 1_000
"""Shapes whose records one statement reads."""


def families_of(
    session: ReadSession, fingerprint: str, wanted: ShapeFilter, least_probability: float
) -> FamiliesAnswer:
    """Return the families of a collection's shapes, each with those of its shapes that match a filter.

    Families are those of the whole collection: a filter shows less of them, and joins or parts none.
    """
    collection = wanted.collection
    everything = np.sort(
        np.array(shapes_repository.numbers(session, ShapeFilter(collection)), dtype=np.int64)
    )
    shown = np.isin(everything, np.array(shapes_repository.numbers(session, wanted), dtype=np.int64))
    labels = families(rows_of(session, fingerprint, everything), float(logit(least_probability)))
    large = shown & (np.bincount(labels[shown], minlength=len(labels) + 1)[labels] > 1)
    label_of = dict(zip(everything[large].tolist(), labels[large].tolist(), strict=True))
    members: dict[int, list[ShapeRecord]] = defaultdict(list)
    numbers = list(label_of)
    for start in range(0, len(numbers), RECORDS_AT_ONCE):
        some = numbers[start : start + RECORDS_AT_ONCE]
        for record in shapes_repository.records(session, collection, some):
            members[label_of[record.number]].append(record)
    return FamiliesAnswer(
        families=[Family(shapes=[Shape.of(record) for record in family]) for family in members.values()],
        single=int(shown.sum()) - len(numbers),
        unknown=count_lacking(session, fingerprint, collection),
    )
