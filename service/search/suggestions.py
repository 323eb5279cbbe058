"""Tags and metadata that the neighbours of a stored shape suggest for it."""

from collections import defaultdict
from typing import Any

import numpy as np
from scipy.special import expit

from core.arrays import Floats, Ints
from core.ranking.diffusion import NOBODY, query_flow
from service.collection import CollectionNumber
from service.index.neighbour_repository import neighbour_rows
from service.search.neighbours import rows_around
from service.search.suggestion_schemas import SuggestingShape, Suggestion, Suggestions
from service.shapes import repository as shapes_repository
from service.shapes import service as shapes_service
from service.shapes.fields import plain_values
from service.shapes.records import ShapeRecord
from service.storage.database import ReadSession

Value = tuple[str | None, str]
"""The key of metadata, or None for a tag; and the value as text."""


def suggestions_for(
    session: ReadSession, fingerprint: str, collection: CollectionNumber, shape_id: str, least_share: float
) -> Suggestions:
    """Return the values that a shape lacks and that its neighbours have by at least a share.

    A neighbour weighs its class probability times the flow from the shape to it, so that neighbours which are
    like each other count more. A key that the shape has is not suggested with another value.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    """
    shape = shapes_service.get(session, collection, shape_id)
    own = neighbour_rows(session, fingerprint, np.array([shape.number]))
    if not len(own.shapes):
        return Suggestions(suggestions=[], known=False)
    known = own.neighbours[0] != NOBODY
    weights = _weights(session, fingerprint, own.neighbours[0, known], own.log_odds[0, known])
    neighbours = shapes_repository.records(session, collection, list(weights))
    having: dict[Value, list[ShapeRecord]] = defaultdict(list)
    for neighbour in neighbours:
        for value in _values(neighbour):
            having[value].append(neighbour)
    total = sum(weights[neighbour.number] for neighbour in neighbours) or 1.0
    present, keys = _values(shape), shape.metadata.keys()
    found = [
        Suggestion(
            key=key,
            value=_values(shapes[0])[key, text],
            share=sum(weights[each.number] for each in shapes) / total,
            shapes=[SuggestingShape(id=each.id, name=each.name) for each in shapes],
        )
        for (key, text), shapes in having.items()
        if (key, text) not in present and key not in keys
    ]
    chosen = [suggestion for suggestion in found if suggestion.share >= least_share]
    chosen.sort(key=lambda suggestion: (-suggestion.share, suggestion.key or "", str(suggestion.value)))
    return Suggestions(suggestions=chosen, known=True)


def _weights(session: ReadSession, fingerprint: str, shapes: Ints, log_odds: Floats) -> dict[int, float]:
    """Return the weights of neighbours by number, the likeliest first."""
    rows = rows_around(session, fingerprint, shapes, without=())
    indices = np.searchsorted(rows.shapes, shapes)
    to_query = np.full(len(rows.shapes), -np.inf)
    to_query[indices] = log_odds
    weights = expit(log_odds) * query_flow(*rows.links(), to_query)[indices]
    return dict(zip(shapes.tolist(), weights.tolist(), strict=True))


def _values(shape: ShapeRecord) -> dict[Value, Any]:
    """Return the tags and the plain metadata of a shape."""
    tags: dict[Value, Any] = {(None, tag): tag for tag in shape.tags}
    plain = plain_values(dict(shape.metadata))
    return tags | {(key, text): shape.metadata[key] for key, text in plain.items()}
