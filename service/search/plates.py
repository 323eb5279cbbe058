"""The stored shapes that a query may be a piece of, and those that may be its pieces.

A part has one piece. A plate or an assembly has several, and is found by the lengths of its pieces
(`core.descriptors.pieces`), however unlike it is to the part as a whole.
"""

import math
from collections import Counter

import numpy as np

from core.arrays import Float32s
from core.descriptors.pieces import COUNT, SIZE, number_of_pieces
from core.registration.instances import EQUAL_SIZE, may_be_instances
from service.container import Container
from service.search import repository
from service.search.records import Candidates, Query
from service.shapes.records import ShapeFilter


def possible_wholes_and_parts(
    container: Container, query: Query, shapes: ShapeFilter, count: int
) -> Candidates | None:
    """Return at most `count` shapes that may have the query as a piece, or be pieces of a query of several.

    Those with more instances come first, then the older ones. None if there are none.
    """
    rows = query.embedding.pieces
    is_part = number_of_pieces(rows) == 1
    fingerprint = query.active_pipeline.fingerprint
    with container.database.read() as session:
        embeddings, lengths = repository.pieces(session, _ranges(rows[:, SIZE]), of_several=is_part)
        instances: Counter[int] = Counter()
        for row in rows:
            for index in np.flatnonzero(may_be_instances(row, lengths)).tolist():
                instances[int(embeddings[index])] += int(lengths[index, COUNT] if is_part else row[COUNT])
        found = {
            shape: instances[embedding]
            for shape, embedding in repository.shapes_of(
                session, fingerprint, shapes, np.array(sorted(instances), dtype=np.int64)
            )
            if shape not in query.excluded
        }
        best = sorted(found, key=lambda number: (-found[number], number))[:count]
        if not best:
            return None
        entries = repository.entries(session, fingerprint, np.array(best))
    place = {number: place for place, number in enumerate(best)}
    order = np.argsort([place[number] for number in entries.shapes.tolist()])
    return Candidates(entries.only(order), shortlisted=False, stored=len(best))


def _ranges(sizes: Float32s) -> list[tuple[float, float]]:
    """Return disjoint ranges of the sizes that instances may have, the largest first."""
    growth = math.exp(EQUAL_SIZE)
    ranges: list[tuple[float, float]] = []
    for size in sorted(sizes.tolist(), reverse=True):
        greatest = size * growth
        if ranges and greatest >= ranges[-1][0]:
            greatest = ranges.pop()[1]
        ranges.append((size / growth, greatest))
    return ranges
